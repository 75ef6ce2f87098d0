//! Cuts of random points, and the photos and points of a block.

use proptest::prelude::*;
use std::collections::BTreeMap;
use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_reconstruct::partition::{
    BlockError, BlockOptions, Sight, Sights, blocks, color_maps, ground_axes, merged, regions,
};
use weaver_scene::Gaussians;

fn point() -> impl Strategy<Value = [f32; 3]> {
    [-10.0_f32..10.0, -10.0..10.0, -10.0..10.0]
}

fn axes() -> impl Strategy<Value = [DVec3; 2]> {
    (-3.0..3.0_f64, -3.0..3.0_f64).prop_map(|(a, b)| {
        let turn = DMat3::from_rotation_y(a) * DMat3::from_rotation_x(b);
        [turn * DVec3::X, turn * DVec3::Z]
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

    /// Every place belongs to exactly one region, near the points and far outside.
    #[test]
    fn regions_share_space(
        points in proptest::collection::vec(point(), 200..400),
        elsewhere in proptest::collection::vec(point(), 20),
        axes in axes(),
        count in 1..12_usize,
    ) {
        let found = regions(&points, axes, count).unwrap();
        prop_assert_eq!(found.len(), count);
        let far = elsewhere.iter().map(|p| p.map(|x| 1000.0 * x));
        for place in points.iter().copied().chain(far) {
            prop_assert_eq!(found.iter().filter(|region| region.contains(place)).count(), 1);
        }
        // The same number in each, give or take one for each of at most four cuts above it.
        for region in &found {
            let own = points.iter().filter(|p| region.contains(**p)).count() as f64;
            prop_assert!((own - points.len() as f64 / count as f64).abs() <= 4.0, "{own} of {}", points.len());
        }
    }

    /// Equal fits of all blocks are joined to one equal scene.
    #[test]
    fn equal_fits_are_joined_to_themselves(
        means in proptest::collection::vec(point(), 100..200),
        axes in axes(),
        count in 1..6_usize,
    ) {
        let found = regions(&means, axes, count).unwrap();
        let n = means.len();
        let fit = Gaussians {
            log_scales: vec![[-3.0; 3]; n],
            quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
            opacity_logits: (0..n).map(|i| i as f32).collect(),
            sh: vec![0.0; 3 * n],
            degree: 0,
            means,
        };
        let all: Vec<_> = found.into_iter().map(|region| (region, fit.clone())).collect();
        let mut joined = merged(&all).opacity_logits;
        joined.sort_unstable_by(f32::total_cmp);
        prop_assert_eq!(joined, fit.opacity_logits);
    }
}

/// Cuts stand on the ground that cameras stand on, however the world is turned.
#[test]
fn the_ground_is_where_cameras_stand() {
    let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(1.1);
    // Cameras around a circle, twice as far along x, that look every way and keep upright.
    let pose = |i: usize| {
        let angle = 0.3 * i as f64;
        let center = turn * DVec3::new(6.0 * angle.cos(), 0.0, 3.0 * angle.sin());
        let rotation = (turn * DMat3::from_rotation_y(2.0 * angle)).transpose();
        Pose { rotation, translation: -(rotation * center) }
    };
    let poses: Vec<Pose> = (0..21).map(pose).collect();
    let [first, second] = ground_axes(&poses);
    let [along, across, up] = [DVec3::X, DVec3::Z, DVec3::Y].map(|axis| turn * axis);
    assert!(first.dot(along).abs() > 0.99 && second.dot(across).abs() > 0.99, "{first} {second}");
    assert!(first.dot(up).abs() < 1e-9 && second.dot(up).abs() < 1e-9);
}

/// Cuts a row of points with ten photos that see eleven each.
fn cut(
    count: usize,
    share: f64,
    held_out: impl Fn(usize) -> bool,
) -> Result<Vec<weaver_reconstruct::partition::Block>, BlockError> {
    let points: Vec<[f32; 3]> = (0..100).map(|i| [i as f32, 0.0, (i % 2) as f32]).collect();
    let seen: Vec<Vec<u32>> = (0..10).map(|i| (10 * i..=(10 * i + 10).min(99)).collect()).collect();
    let pose = |i: usize| Pose { translation: DVec3::new(-10.0 * i as f64, 0.0, 0.0), ..Pose::IDENTITY };
    let photo = |i: usize| Sight { pose: pose(i), visible: &seen[i], held_out: held_out(i) };
    let photos: Vec<Sight> = (0..10).map(photo).collect();
    blocks(&Sights { points: &points, photos: &photos }, &BlockOptions { count, share })
}

/// A block has the photos with enough of it, and the points that its training photos see.
#[test]
fn a_block_takes_what_its_photos_see() {
    let two = cut(2, 0.2, |_| false).unwrap();
    // Photo 4 sees points 40 to 50; the last alone is the other block's.
    assert_eq!((&two[0].photos[..], &two[1].photos[..]), (&[0, 1, 2, 3, 4][..], &[5, 6, 7, 8, 9][..]));
    assert_eq!((two[0].own, two[0].points.len(), two[1].points.len()), (50, 51, 50));
    let more = cut(2, 0.05, |_| false).unwrap();
    assert_eq!(more[1].photos, [4, 5, 6, 7, 8, 9]);
    assert_eq!(more[1].points.first(), Some(&40));
    // A photo that is held out brings no points.
    let held_out = cut(2, 0.05, |i| i == 4).unwrap();
    assert_eq!((held_out[1].photos.len(), held_out[1].points.len()), (6, 50));
}

/// Too few points, or none that a photo to fit to sees, are refused.
#[test]
fn too_little_for_so_many_blocks_is_refused() {
    let refused = cut(13, 0.2, |_| false).unwrap_err();
    assert_eq!(refused, BlockError::Points { blocks: 13, needed: 104, found: 100 });
    assert!(refused.to_string().contains("at least 104, 8 for each of 13 blocks, found 100"), "{refused}");
    let unseen = cut(2, 0.2, |i| i < 5).unwrap_err();
    assert!(matches!(unseen, BlockError::Photos { block: 0, blocks: 2, .. }), "{unseen}");
}

/// A map that loses no color.
fn color_map() -> impl Strategy<Value = [f32; 12]> {
    proptest::array::uniform12(-0.1_f32..0.1)
        .prop_map(|x| std::array::from_fn(|i| x[i] + f32::from(u8::from(i % 5 == 0))))
}

fn mapped(map: &[f32; 12], color: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|row| (0..3).map(|i| map[4 * row + i] * color[i]).sum::<f32>() + map[4 * row + 3])
}

/// The map that applies `first` and then `then`.
fn chained(then: &[f32; 12], first: &[f32; 12]) -> [f32; 12] {
    let column = |i: usize| [0, 1, 2].map(|row| first[4 * row + i]);
    let origin = mapped(then, [0.0; 3]);
    let columns: [[f32; 3]; 4] = std::array::from_fn(|i| {
        let to = mapped(then, column(i));
        if i == 3 { to } else { [0, 1, 2].map(|row| to[row] - origin[row]) }
    });
    std::array::from_fn(|i| columns[i % 4][i / 4])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

    /// Blocks in a row, each with two photos of the next: planted differences of their colors are found, and a photo
    /// looks the same by any of them. A block that shares no photo stays as it is.
    ///
    /// Promise (results): fits of blocks that correct the colors of their photos are joined to one color; where all
    /// photos see all blocks, the cut warns that it is not worth it.
    #[test]
    fn colors_of_blocks_agree(
        photos in proptest::collection::vec(color_map(), 14),
        turns in proptest::collection::vec(color_map(), 5),
        color in proptest::array::uniform3(0.0_f32..1.0),
    ) {
        let names: Vec<String> = (0..photos.len()).map(|i| format!("{i}.jpg")).collect();
        // The colors of block b are the common colors, turned; its corrections E turn them back.
        let mut blocks: Vec<BTreeMap<String, [f32; 12]>> = turns
            .iter()
            .enumerate()
            .map(|(b, turn)| {
                let own = 2 * b..2 * b + 4;
                own.map(|p| (names[p].clone(), chained(&photos[p], turn))).collect()
            })
            .collect();
        blocks.push(BTreeMap::from([("elsewhere.jpg".into(), photos[13])]));
        let maps = color_maps(&blocks);
        prop_assert!(maps[5].is_none());
        // The planted maps: common colors c are seen as c_b with turn(c_b) = c, so that the map of each block is its
        // turn, up to one for all.
        let seen = |b: usize| mapped(&maps[b].unwrap(), mapped(&inverse(&turns[b]), color));
        for b in 1..5 {
            prop_assert!(seen(b).iter().zip(seen(0)).all(|(a, b)| (a - b).abs() < 2e-3), "{b}: {:?} {:?}", seen(b), seen(0));
        }
    }
}

fn inverse(map: &[f32; 12]) -> [f32; 12] {
    let column = |i: usize| DVec3::new(map[i].into(), map[4 + i].into(), map[8 + i].into());
    let inverse = DMat3::from_cols(column(0), column(1), column(2)).inverse();
    let offset = -(inverse * column(3));
    std::array::from_fn(|i| if i % 4 == 3 { offset[i / 4] } else { inverse.col(i % 4)[i / 4] } as f32)
}
