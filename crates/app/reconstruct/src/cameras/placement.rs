//! Remarks about the world that estimated cameras were brought to.

use weaver_data::Placement;
use weaver_geometry::geodesy::Origin;
use weaver_io::Observe;

/// Says by what the world has meters and a vertical, and how exactly.
pub fn remark_placement(placement: &Placement, observe: &mut dyn Observe) {
    let vertical = placement.vertical.as_deref().map(|vertical| match vertical {
        "positions" => "the positions",
        "gimbal" => "the drone's gimbal",
        "ground" => "the ground",
        _ => "the horizons of the photos",
    });
    match &placement.positions {
        Some(fit) if fit.followed => observe.note(&format!(
            "cameras: meters, east, north and up by {}: {} of {} cameras agree, off by {:.2} m along the \
             ground in the median, {:.2} at most, and {:.2} m in height; scale +- {:.1} %; level by {}",
            fit.source,
            fit.used,
            fit.cameras,
            fit.median,
            fit.largest,
            fit.height,
            100.0 * fit.scale_deviation,
            vertical.unwrap_or("nothing")
        )),
        Some(fit) => observe.note(&format!(
            "cameras: {} of {} cameras is too coarse to set the scale: off by {:.2} m in the median, which leaves {:.0} % \
             open; --positions FILE gives better ones, --scale-bar FILE a length",
            fit.source,
            fit.cameras,
            fit.median,
            100.0 * fit.scale_deviation
        )),
        None => {}
    }
    if let (false, Some(vertical)) = (placement.east_north_up, vertical) {
        observe.note(&format!("cameras: upright by {vertical}"));
    }
    if let Some(bar) = placement.scale_bar.as_ref().filter(|bar| bar.photos < 2) {
        let photos = bar.photos;
        observe.warning(&format!("--scale-bar: {photos} of its photos have a camera, two are needed: no meters by it"));
    } else if let Some(bar) = &placement.scale_bar {
        observe.note(&format!(
            "cameras: the bar of {:.4} m is {:.4} m long by {} photos, its ends off by {:.2} pixels",
            bar.length, bar.found, bar.photos, bar.error_pixels
        ));
    }
    match placement.origin {
        Some(Origin::Geographic(place)) => observe.note(&format!(
            "cameras: the origin is at latitude {:.7}, longitude {:.7}, altitude {:.2} m",
            place.latitude, place.longitude, place.altitude
        )),
        Some(Origin::Local { offset: [x, y, z] }) => {
            observe.note(&format!("cameras: the origin is at {x:.3}, {y:.3}, {z:.3} of the positions' frame"));
        }
        None => {}
    }
    if let Some(sample) = placement.ground_sample {
        observe.note(&format!("cameras: a pixel of the photos is {:.2} cm wide where the points are", 100.0 * sample));
    }
}
