//! The published methods: the one place where the product refers to them. Each is behind a Cargo feature of its name.

use crate::table::table;
use clap::Subcommand;
#[cfg(not(all(feature = "dynamic", feature = "image", feature = "lidar")))]
use std::path::Path;
use weaver_command::{Console, Failure, Interrupt};
use weaver_trainer::Registry;

#[cfg(feature = "dynamic")]
pub use weaver_dynamic::command::film;
#[cfg(feature = "image")]
pub use weaver_image::command::info as describe_picture;
#[cfg(feature = "lidar")]
pub use weaver_lidar::command::map_views;

table! {
    Method:
    "Methods": {
        #[cfg(feature = "lift")]
        Lift(weaver_lift::command::Lift) => |it, console, _| weaver_lift::command::lift(it, console),
        #[cfg(feature = "lift")]
        Query(weaver_lift::command::Query) => |it, console, _| weaver_lift::command::query(it, console),
        #[cfg(feature = "dynamic")]
        Dynamic(weaver_dynamic::command::Dynamic) => weaver_dynamic::command::run,
        #[cfg(feature = "vad")]
        Vad(weaver_vad::command::Vad) => weaver_vad::command::run,
        #[cfg(feature = "lidar")]
        Lidar(weaver_lidar::command::Lidar) => weaver_lidar::command::run,
        #[cfg(feature = "lidar")]
        EvalTrajectory(weaver_lidar::command::EvalTrajectory) => |it, console, _| {
            weaver_lidar::command::eval_trajectory(it, console)
        },
        #[cfg(feature = "lidar")]
        EvalMesh(weaver_lidar::command::EvalMesh) => |it, console, _| weaver_lidar::command::eval_mesh(it, console),
        #[cfg(feature = "image")]
        Image(weaver_image::command::Pictures) => weaver_image::command::run,
        #[cfg(feature = "bench")]
        Bench(weaver_bench::Bench) => weaver_bench::run,
    }
}

/// The models that a name selects: the product's own, and those of methods, a row each.
pub fn models() -> Registry {
    let registry = Registry::default();
    #[cfg(feature = "two-experts")]
    let registry = registry.with::<weaver_two_experts::TwoExpertsRecipe>();
    #[cfg(feature = "wild")]
    let registry = registry.with::<weaver_wild::WildRecipe>();
    registry
}

/// In place of methods that the program was built without.
#[cfg(not(feature = "dynamic"))]
pub fn film(
    folder: &Path,
    _: Option<&str>,
    _: weaver_command::DrawingOptions,
    _: Option<f64>,
) -> Result<weaver_view_run::ScenePage, Failure> {
    Err(left_out(folder, "dynamic"))
}

#[cfg(not(feature = "image"))]
pub fn describe_picture(file: &Path) -> Result<String, Failure> {
    Err(left_out(file, "image"))
}

#[cfg(not(feature = "lidar"))]
pub fn map_views<T>(
    run: &Path,
    _: &mut Console,
    _: impl FnOnce(&[weaver_mesh::RangeView<'_>], &mut Console) -> Result<T, Failure>,
) -> Result<T, Failure> {
    Err(left_out(run, "lidar"))
}

#[cfg(not(all(feature = "dynamic", feature = "image", feature = "lidar")))]
fn left_out(path: &Path, method: &str) -> Failure {
    let path = path.display();
    Failure::message(format!("{path}: expected a program that was built with `{method}`, found one without it"))
}
