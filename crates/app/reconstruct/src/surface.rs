//! Meshes of scenes, with textures from the photos.

use crate::Error;
use std::path::Path;
use weaver_data::capture::posed::{PosedOptions, load_frames};
use weaver_geometry::Camera;
use weaver_io::{Bitmap, Observe, Part, ScratchFile, Stage, Surface, SurfaceTexture, check_memory, read_cameras};
use weaver_mesh::{DistanceField, DrawnScene, FieldProgress, Mesh, PhotoView, RangeView, Texture};
use weaver_scene::{Frame, Photo};

/// The largest pieces of a scene that are kept, and the least triangles of each.
const PIECES: (usize, usize) = (50, 50);
/// Cells of the truncation of a scene.
const TRUNCATION: f64 = 5.0;
/// Bytes of a texel and of a photo's depth while a texture is painted.
const TEXEL: u64 = 24;
const SIGHT: u64 = 2_000_000;

/// Choices that make a surface of range images.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceOptions {
    /// Side of a cell, world units.
    pub voxel: f64,
    /// The most triangles; all that there are if `None`.
    pub triangles: Option<usize>,
    /// Closes the holes that no photo saw.
    pub watertight: bool,
}

/// A mesh with colors or a texture.
#[derive(Clone, Debug, Default)]
pub struct SceneSurface {
    /// The mesh.
    pub mesh: Mesh,
    /// Colors of its vertices, or none.
    pub colors: Vec<[u8; 3]>,
    /// The texture, if there is to be one.
    pub texture: Option<Texture>,
}

impl SceneSurface {
    /// Writes it in the format of the name's ending, as [`weaver_io::Surface::write`] does.
    ///
    /// # Errors
    /// As there.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let picture = |it: &Texture| Bitmap { width: it.size, height: it.size, pixels: it.pixels.clone() };
        let picture = self.texture.as_ref().map(picture);
        let texture = self.texture.as_ref().zip(picture.as_ref()).map(|(it, picture)| SurfaceTexture {
            coordinates: &it.coordinates,
            vertices: &it.vertices,
            corners: &it.corners,
            picture,
        });
        let Self { mesh, colors, .. } = self;
        Ok(Surface { vertices: &mesh.vertices, triangles: &mesh.triangles, colors, texture }.write(path)?)
    }
}

impl SurfaceOptions {
    /// The surface of range images whose distances are cut at `truncation`: fused, closed, without small pieces where
    /// `pieces` is true, a manifold, and simplified. `colors` are asked for the vertices of all triangles.
    ///
    /// # Errors
    /// When sizes make no sense, or memory is too small.
    pub fn surface(
        &self,
        views: &[RangeView<'_>],
        (truncation, pieces): (f64, bool),
        colors: impl Fn(&[[f32; 3]]) -> Vec<[u8; 3]>,
        observe: &mut dyn Observe,
    ) -> Result<SceneSurface, Error> {
        let advice = format!("cells twice as wide (--voxel {}) take a quarter", 2.0 * self.voxel);
        observe.begin(&Stage { label: "field", done: 0, total: views.len(), stops_after: None });
        let field = DistanceField::watched(views, self.voxel, truncation, |FieldProgress { done, of, bytes }| {
            if done <= views.len() {
                check_memory(bytes, &advice)?;
            }
            told(observe, "field", done, of);
            Ok::<(), Error>(())
        })?;
        let field = if self.watertight { field.closed(views)? } else { field };
        let mesh = field.mesh();
        drop(field);
        let (most, least) = if pieces { PIECES } else { (usize::MAX, 1) };
        let mesh = mesh.manifold().largest_pieces(most, least);
        let colors = colors(&mesh.vertices);
        let all = mesh.triangles.len();
        let most = self.triangles.unwrap_or(all);
        if most > all {
            observe.note(&format!("--triangles {most}: the mesh has {all}, and stays as it is"));
        }
        if most >= all {
            return Ok(SceneSurface { mesh, colors, texture: None });
        }
        observe.begin(&Stage { label: "simplify", done: 0, total: all - most, stops_after: None });
        let (mesh, colors) = mesh.simplified(&colors, most, |left| told(observe, "simplify", all - left, all - most));
        if mesh.triangles.len() > most {
            let left = mesh.triangles.len();
            observe.note(&format!("--triangles {most}: {left} are needed to keep every hole and handle"));
        }
        Ok(SceneSurface { mesh, colors, texture: None })
    }

    /// The mesh of a scene as cameras see it, its small pieces left out; colors are those that the cameras see.
    ///
    /// # Errors
    /// As [`surface`](Self::surface), and when a camera cannot be drawn.
    pub fn scene(
        &self,
        scene: &mut DrawnScene,
        cameras: &[Camera],
        observe: &mut dyn Observe,
    ) -> Result<SceneSurface, Error> {
        observe.begin(&Stage { label: "mesh", done: 0, total: cameras.len(), stops_after: None });
        for (i, camera) in cameras.iter().enumerate() {
            scene.add(camera)?;
            told(observe, "mesh", i + 1, cameras.len());
        }
        let reach = TRUNCATION * self.voxel;
        let colors = |vertices: &[[f32; 3]]| scene.colors(vertices, reach);
        self.surface(&scene.views(), (reach, true), colors, observe)
    }
}

/// Photos that a mesh can be painted from, found before any work.
#[derive(Clone, Debug)]
pub struct TexturePhotos<'a> {
    file: &'a Path,
    frames: Vec<Frame>,
}

impl<'a> TexturePhotos<'a> {
    /// The photos of a file of cameras.
    ///
    /// # Errors
    /// When it cannot be read, and naming the photos that are missing.
    pub fn of(file: &'a Path) -> Result<Self, Error> {
        let frames = read_cameras(file)?;
        let missing: Vec<String> =
            frames.iter().filter(|frame| !frame.path.is_file()).map(|frame| frame.name.clone()).collect();
        match missing.is_empty() {
            true => Ok(Self { file, frames }),
            false => Err(Error::MissingPhotos { file: file.into(), missing, all: frames.len() }),
        }
    }

    /// Paints a surface, on a texture of `size` x `size` texels. Photos are read one after the other, and kept on disk.
    ///
    /// # Errors
    /// When a photo cannot be read, memory is too small, or the texture is.
    pub fn paint(&self, surface: &mut SceneSurface, size: usize, observe: &mut dyn Observe) -> Result<(), Error> {
        let bytes = TEXEL * (size * size) as u64 + SIGHT * self.frames.len() as u64;
        check_memory(bytes, &format!("half the side (--texture {}) takes a quarter", size / 2))?;
        let scratch = ScratchFile::new(&std::env::temp_dir())?;
        observe.begin(&Stage { label: "photos", done: 0, total: self.frames.len(), stops_after: None });
        let mut photos: Vec<Photo> = Vec::new();
        for frame in &self.frames {
            for posed in load_frames(vec![frame.clone()], self.file, &PosedOptions::default())? {
                let rgb = scratch.keep(&posed.photo.rgb)?;
                photos.push(Photo { rgb, ..posed.photo });
            }
            told(observe, "photos", photos.len(), self.frames.len());
        }
        let views: Vec<PhotoView<'_>> = photos.iter().map(view).collect();
        observe.begin(&Stage { label: "texture", done: 0, total: views.len(), stops_after: None });
        let texture = Texture::paint(&surface.mesh, &views, size, |done, total| told(observe, "texture", done, total))?;
        let unseen = 100.0 * (1.0 - texture.seen);
        observe
            .note(&format!("texture: {unseen:.1} % of the surface is seen by no photo, and takes the colors around"));
        surface.texture = Some(texture);
        Ok(())
    }
}

fn view(photo: &Photo) -> PhotoView<'_> {
    PhotoView { camera: photo.camera, rgb: &photo.rgb, mask: photo.mask.as_deref() }
}

fn told(observe: &mut dyn Observe, label: &'static str, done: usize, total: usize) {
    let _ = observe.progress(&Part { label, done, total, note: String::new() });
}
