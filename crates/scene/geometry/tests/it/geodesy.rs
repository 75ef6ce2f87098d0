//! Places on the Earth.

use proptest::prelude::*;
use weaver_geometry::geodesy::Geographic;
use weaver_geometry::glam::DVec3;

/// The ellipsoid's own radii, and steps of a thousandth of a degree whose lengths are known.
#[test]
fn known_places_have_their_coordinates() {
    let pole = Geographic { latitude: 90.0, longitude: 0.0, altitude: 0.0 };
    assert!(pole.to_geocentric().distance(DVec3::new(0.0, 0.0, 6_356_752.314_245)) < 1e-3);
    let here = Geographic { latitude: 0.0, longitude: 0.0, altitude: 0.0 };
    // A degree of longitude at the equator is 111.3195 km, one of latitude 110.5743.
    let east = here.to_local(&Geographic { longitude: 1e-3, ..here });
    assert!(east.distance(DVec3::new(111.3195, 0.0, 0.0)) < 2e-3, "{east}");
    let north = here.to_local(&Geographic { latitude: 1e-3, ..here });
    assert!(north.distance(DVec3::new(0.0, 110.5743, 0.0)) < 2e-3, "{north}");
    let up = here.to_local(&Geographic { altitude: 5.0, ..here });
    assert!(up.distance(DVec3::new(0.0, 0.0, 5.0)) < 1e-8, "{up}");
}

proptest! {
    #[test]
    fn geocentric_places_come_back(
        latitude in -90.0..90.0_f64, longitude in -179.9..179.9_f64, altitude in -500.0..20_000.0_f64,
    ) {
        let place = Geographic { latitude, longitude, altitude };
        let back = Geographic::from_geocentric(place.to_geocentric());
        prop_assert!((back.latitude - latitude).abs() < 1e-9 && (back.altitude - altitude).abs() < 1e-5);
        prop_assert!(place.to_geocentric().distance(back.to_geocentric()) < 1e-5);
    }
}
