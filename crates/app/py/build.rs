//! Link arguments of the library.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    // Python's functions are found when the interpreter loads the library; other linkers leave them open by default.
    if std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "macos") {
        println!("cargo:rustc-cdylib-link-arg=-undefined");
        println!("cargo:rustc-cdylib-link-arg=dynamic_lookup");
    }
}
