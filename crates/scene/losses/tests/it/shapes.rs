//! Wrong shapes are refused with the loss's name, the model path, and every shape found.

use std::panic::{AssertUnwindSafe, catch_unwind};
use weaver_autograd::{Tape, Var};
use weaver_losses::*;

/// Takes a result that never comes.
fn done<X>(_: X) {}

type Case = (&'static str, &'static [&'static [usize]], fn(&[Var<'_, f64>]));

/// The loss's name, shapes that do not fit it, and the call.
const CASES: &[Case] = &[
    ("error_regression", &[&[4, 4], &[2, 8]], |x| done(error_regression(x[0], x[1], None))),
    ("error_regression", &[&[15], &[1, 4, 4]], |x| done(error_regression(x[0], x[1], None))),
    ("masked_depth_mse", &[&[4, 4], &[4, 4], &[4, 4]], |x| done(masked_depth_mse(x[0], x[1], x[2], 0.3))),
    ("masked_depth_mse", &[&[1, 4, 4], &[1, 4, 4], &[1, 4, 5]], |x| done(masked_depth_mse(x[0], x[1], x[2], 0.3))),
    ("share_budget", &[&[6, 3]], |x| done(share_budget(x[0], &[0.2, 0.02, 0.02]))),
    ("global_budget", &[&[2, 3, 4]], |x| done(global_budget(x[0], 0.5))),
    ("max_pool2d", &[&[1, 2, 2, 3]], |x| done(max_pool2d(x[0], 3, 2))),
    ("max_pool2d", &[&[1, 2, 3, 2]], |x| done(max_pool2d(x[0], 3, 2))),
    ("max_pool2d", &[&[2, 3, 3]], |x| done(max_pool2d(x[0], 3, 2))),
    ("rotation_angles", &[&[], &[]], |x| done(rotation_angles(x[0], x[1]))),
    ("rotation_angles", &[&[2, 8], &[2, 8]], |x| done(rotation_angles(x[0], x[1]))),
    ("rotation_angles", &[&[2, 9], &[1, 9]], |x| done(rotation_angles(x[0], x[1]))),
    ("focal_error", &[&[], &[]], |x| done(focal_error(x[0], x[1], 9))),
    ("focal_error", &[&[2, 3], &[2, 3]], |x| done(focal_error(x[0], x[1], 9))),
    ("focal_error", &[&[2, 4], &[1, 4]], |x| done(focal_error(x[0], x[1], 9))),
    ("ssim", &[&[3, 11, 11], &[3, 11, 11]], |x| done(ssim(x[0], x[1]))),
    ("ssim", &[&[1, 0, 11, 11], &[1, 0, 11, 11]], |x| done(ssim(x[0], x[1]))),
    ("ssim", &[&[1, 1, 10, 11], &[1, 1, 10, 11]], |x| done(ssim(x[0], x[1]))),
    ("ssim", &[&[1, 1, 11, 10], &[1, 1, 11, 10]], |x| done(ssim(x[0], x[1]))),
    ("huber_pose", &[&[1, 2, 9], &[1, 2, 9], &[1, 2, 9]], |x| done(huber_pose(&x[..2], &x[2..], 1.0))),
    ("absolute_pose", &[&[1, 3, 3], &[1, 3], &[1, 3]], |x| done(absolute_pose(&x[..1], &x[1..], x[0], x[1]))),
];

#[test]
fn messages_name_loss_path_and_shapes() {
    for (loss, shapes, call) in CASES {
        let tape = Tape::<f64>::new();
        let vars: Vec<_> = shapes.iter().map(|s| tape.leaf(&vec![0.5; s.iter().product()], *s)).collect();
        let term = || tape.part("losses.term", || call(&vars));
        let panic = catch_unwind(AssertUnwindSafe(term)).expect_err("shapes that do not fit are refused");
        let message = panic.downcast::<String>().expect("a formatted message");
        let start = format!("losses.term: {loss}: expected ");
        assert!(message.starts_with(&start), "{message:?} does not start with {start:?}");
        let (_, found) = message.split_once("found ").expect("what was found");
        let shapes: Vec<_> = shapes.iter().map(|shape| format!("{shape:?}")).collect();
        assert_eq!(found, shapes.join(", "));
    }
}
