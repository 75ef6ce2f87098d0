//! What is asked of `reconstruct`.

use weaver_reconstruct::{Photos, Request, reconstruct};

/// Numbers out of range are refused before photos are read, and leave no folder.
#[test]
fn numbers_out_of_range_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene");
    let refused = |change: fn(&mut Request)| {
        let mut request = Request::new(&out);
        change(&mut request);
        let error = reconstruct(&Photos::Demo, &request, &mut ()).unwrap_err().to_string();
        assert!(!out.exists(), "{error}");
        error
    };
    type Change = fn(&mut Request);
    let changes: [(Change, &str); 5] = [
        (|r| r.minutes = Some(-1.0), "minutes"),
        (|r| r.minutes = Some(f64::NAN), "minutes"),
        (|r| r.gaussians = Some(0), "gaussians"),
        (|r| r.gaussians = Some(200_000_000), "gaussians"),
        (|r| r.compress = Some(3.5), "compress"),
    ];
    for (change, key) in changes {
        let error = refused(change);
        assert!(error.contains(key), "{key}: {error}");
    }
}
