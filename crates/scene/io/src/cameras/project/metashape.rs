//! Cameras of Agisoft Metashape, as its command Export Cameras writes them in the form Agisoft XML.
//!
//! Poses are camera to world with OpenCV's axes. The principal point is an offset from the middle of the photo. P1 and
//! P2 are OpenCV's p2 and p1. B1 is a difference of the focal lengths; B2 is skew. A component has a similarity
//! transform from its own coordinates to the world's, which are geocentric where the chunk is georeferenced.

use super::{Project, ProjectKind, Source, lens};
use crate::Result;
use crate::files::file::read_text;
use roxmltree::{Document, Node};
use std::collections::BTreeMap;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Distortion, Intrinsics, Pose, Similarity};
use weaver_scene::Frame;

/// Largest shift by skew in a photo that is left out, pixels.
const LARGEST_SKEW: f64 = 0.5;

/// A sensor: what its photos have in common.
#[derive(Clone, Copy)]
struct Sensor {
    size: (usize, usize),
    intrinsics: Intrinsics,
    distortion: Option<Distortion>,
}

pub(super) fn read(source: &Source) -> Result<Project> {
    let text = read_text(source.path)?;
    let document = Document::parse(&text).map_err(|error| {
        let at = error.pos();
        let expected = "the XML that Metashape's Export Cameras writes; export it again if it is cut off";
        source.invalid(format!("line {} column {}", at.row, at.col), expected, error)
    })?;
    let reader = Reader { source, document: &document };
    let chunks = children(document.root_element(), "chunk");
    let posed: Vec<Node> = chunks.into_iter().filter(|chunk| cameras(*chunk).any(|camera| is_posed(&camera))).collect();
    let chunk = match posed[..] {
        [] => return Ok(Project::new(ProjectKind::Metashape, Vec::new())),
        [chunk] => chunk,
        _ => {
            let labels = posed.iter().map(|chunk| chunk.attribute("label").unwrap_or("?")).collect::<Vec<_>>();
            let expected = "one chunk of aligned photos; merge the chunks, or export the cameras of one";
            return Err(source.invalid("chunk", expected, format!("{}: {}", labels.len(), labels.join(", "))));
        }
    };
    let world = reader.world(chunk)?;
    let mut sensors = BTreeMap::new();
    let (mut frames, mut unposed) = (Vec::new(), Vec::new());
    for camera in cameras(chunk) {
        let label = reader.attribute(camera, "label")?;
        if !is_posed(&camera) {
            unposed.push(label.to_string());
            continue;
        }
        let id = reader.attribute(camera, "sensor_id")?;
        let sensor = match sensors.get(id) {
            Some(sensor) => *sensor,
            None => *sensors.entry(id.to_string()).or_insert(reader.sensor(chunk, camera, id)?),
        };
        let place = format!("camera {label:?}");
        let Some(matrix) = child(camera, "transform") else { continue };
        let numbers = reader.numbers::<16>(matrix, &place)?;
        let rows = [0, 4, 8].map(|at| [numbers[at], numbers[at + 1], numbers[at + 2], numbers[at + 3]]);
        let to_world = Pose::from_rows(&rows)
            .map_err(|error| source.invalid(format!("{place}, transform"), "a rotation and a shift", error))?;
        let pose = world.apply_to_pose(&to_world.inverse());
        let Sensor { size, intrinsics, distortion } = sensor;
        let (name, path, _) = source.photo(&place, label, Some(size))?;
        let camera = Camera { pose, intrinsics, width: size.0, height: size.1 };
        frames.push(Frame { path, distortion, ..Frame::new(name, camera) });
    }
    let mut project = Project::new(ProjectKind::Metashape, frames);
    project.remark_unposed(source.path, &unposed);
    Ok(project)
}

fn children<'a, 'i>(node: Node<'a, 'i>, name: &'static str) -> Vec<Node<'a, 'i>> {
    node.children().filter(|child| child.has_tag_name(name)).collect()
}

fn child<'a, 'i>(node: Node<'a, 'i>, name: &'static str) -> Option<Node<'a, 'i>> {
    node.children().find(|child| child.has_tag_name(name))
}

/// The cameras of a chunk, also those in groups.
fn cameras<'a, 'i>(chunk: Node<'a, 'i>) -> impl Iterator<Item = Node<'a, 'i>> {
    let list = child(chunk, "cameras");
    list.into_iter().flat_map(|list| list.descendants()).filter(|node| node.has_tag_name("camera"))
}

/// True for a camera with a pose that takes part.
fn is_posed(camera: &Node) -> bool {
    child(*camera, "transform").is_some() && camera.attribute("enabled") != Some("false")
}

struct Reader<'a, 'i> {
    source: &'a Source<'a>,
    document: &'a Document<'i>,
}

impl Reader<'_, '_> {
    /// The transform from the coordinates of poses to the world's.
    fn world(&self, chunk: Node) -> Result<Similarity> {
        let ids: Vec<&str> =
            cameras(chunk).filter(is_posed).map(|c| c.attribute("component_id").unwrap_or("")).collect();
        let first = ids.first().copied().unwrap_or("");
        if let Some(other) = ids.iter().find(|id| **id != first) {
            let expected = "photos of one component; align all photos, or export one component";
            return Err(self.source.invalid("component_id", expected, format!("{first:?} and {other:?}")));
        }
        let components = child(chunk, "components").map_or(Vec::new(), |list| children(list, "component"));
        let component = components.into_iter().find(|component| component.attribute("id") == Some(first));
        let transform =
            component.and_then(|component| child(component, "transform")).or_else(|| child(chunk, "transform"));
        let identity = Similarity { scale: 1.0, rotation: DMat3::IDENTITY, translation: DVec3::ZERO };
        let Some(transform) = transform else { return Ok(identity) };
        let place = "transform of the component";
        let rotation = match child(transform, "rotation") {
            None => DMat3::IDENTITY,
            Some(node) => {
                let r = self.numbers::<9>(node, place)?;
                let rows = [0, 3, 6].map(|at| [r[at], r[at + 1], r[at + 2], 0.0]);
                Pose::from_rows(&rows).map_err(|error| self.source.invalid(place, "a rotation", error))?.rotation
            }
        };
        let translation = match child(transform, "translation") {
            None => DVec3::ZERO,
            Some(node) => DVec3::from(self.numbers::<3>(node, place)?),
        };
        let scale = match child(transform, "scale") {
            None => 1.0,
            Some(node) => self.numbers::<1>(node, place)?[0],
        };
        if scale <= 0.0 {
            return Err(self.source.invalid(format!("{place}, scale"), "a positive number", scale));
        }
        Ok(Similarity { scale, rotation, translation })
    }

    /// The sensor of a camera.
    fn sensor(&self, chunk: Node, camera: Node, id: &str) -> Result<Sensor> {
        let source = self.source;
        let sensors = child(chunk, "sensors").map_or(Vec::new(), |list| children(list, "sensor"));
        let Some(sensor) = sensors.into_iter().find(|sensor| sensor.attribute("id") == Some(id)) else {
            let label = camera.attribute("label").unwrap_or("?");
            return Err(source.invalid(
                format!("camera {label:?}, sensor_id"),
                "a sensor of the chunk",
                format!("{id:?}"),
            ));
        };
        let place = format!("sensor {:?}", sensor.attribute("label").unwrap_or(id));
        let calibrations = children(sensor, "calibration");
        let adjusted = calibrations.iter().find(|node| node.attribute("class") == Some("adjusted"));
        let Some(calibration) = adjusted.or(calibrations.first()).copied() else {
            let expected = "a calibration; align the photos before you export the cameras";
            return Err(source.invalid(place, expected, "none"));
        };
        let Some(resolution) = child(calibration, "resolution").or_else(|| child(sensor, "resolution")) else {
            return Err(source.invalid(place, "a resolution", "none"));
        };
        let side = |key: &str| -> Result<usize> {
            let text = self.attribute(resolution, key)?;
            let side = text.parse().ok().filter(|side| (1..=1 << 20).contains(side));
            side.ok_or_else(|| source.invalid(format!("{place}, {key}"), "a size in pixels", format!("{text:?}")))
        };
        let size = (side("width")?, side("height")?);
        let number = |key: &'static str| -> Result<f64> {
            child(calibration, key).map_or(Ok(0.0), |node| Ok(self.numbers::<1>(node, &place)?[0]))
        };
        let (w, h) = (size.0 as f64, size.1 as f64);
        let absolute = child(calibration, "f").is_none();
        // PhotoScan up to 1.1 wrote two focal lengths, and the principal point itself.
        let intrinsics = if absolute {
            Intrinsics { fx: number("fx")?, fy: number("fy")?, cx: number("cx")?, cy: number("cy")? }
        } else {
            let f = number("f")?;
            Intrinsics { fx: f + number("b1")?, fy: f, cx: 0.5 * w + number("cx")?, cy: 0.5 * h + number("cy")? }
        };
        if !(intrinsics.fx > 0.0 && intrinsics.fy > 0.0) {
            let found = format!("{} and {}", intrinsics.fx, intrinsics.fy);
            return Err(source.invalid(format!("{place}, f"), "a positive focal length", found));
        }
        let skew = number(if absolute { "skew" } else { "b2" })?;
        let shift = (skew * 0.5 * h / intrinsics.fy).abs();
        if shift > LARGEST_SKEW {
            let expected = "at most half a pixel of skew; optimize without B2, or export undistorted photos";
            return Err(source.invalid(format!("{place}, b2"), expected, format!("{shift:.1} pixels")));
        }
        let (k, p) = ([number("k1")?, number("k2")?, number("k3")?, number("k4")?], [number("p1")?, number("p2")?]);
        for key in ["p3", "p4"] {
            if number(key)? != 0.0 {
                let expected = "0; optimize without it, or export undistorted photos";
                return Err(source.invalid(format!("{place}, {key}"), expected, number(key)?));
            }
        }
        let distortion = match calibration.attribute("type").or(sensor.attribute("type")) {
            None | Some("frame") => lens::brown(k, [p[1], p[0]], &intrinsics, size).map_err(|off| {
                let expected = "a lens that OpenCV's model fits to a tenth of a pixel; optimize without K4";
                source.invalid(format!("{place}, k4"), expected, format!("{off:.2} pixels"))
            })?,
            Some("fisheye") if p == [0.0; 2] => Some(Distortion::Fisheye { k }),
            Some("fisheye") => {
                let expected = "0 for a fisheye; optimize without P1 and P2, or export undistorted photos";
                return Err(source.invalid(format!("{place}, p1"), expected, format!("{p:?}")));
            }
            Some(other) => {
                let expected = "a sensor of type frame or fisheye; export undistorted photos of others";
                return Err(source.invalid(place, expected, other));
            }
        };
        Ok(Sensor { size, intrinsics, distortion })
    }

    fn attribute<'n>(&self, node: Node<'n, '_>, key: &str) -> Result<&'n str> {
        node.attribute(key).ok_or_else(|| {
            let line = self.document.text_pos_at(node.range().start).row;
            self.source.invalid(format!("line {line}, {}", node.tag_name().name()), format!("{key:?}"), "nothing")
        })
    }

    /// The numbers in an element.
    fn numbers<const N: usize>(&self, node: Node, place: &str) -> Result<[f64; N]> {
        let text = node.text().unwrap_or("");
        let numbers: Option<Vec<f64>> =
            text.split_whitespace().map(|word| word.parse().ok().filter(|x: &f64| x.is_finite())).collect();
        numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| {
            let line = self.document.text_pos_at(node.range().start).row;
            let place = format!("line {line}, {place}, {}", node.tag_name().name());
            let found: String = text.trim().chars().take(100).collect();
            self.source.invalid(place, format!("{N} finite numbers"), format!("{found:?}"))
        })
    }
}
