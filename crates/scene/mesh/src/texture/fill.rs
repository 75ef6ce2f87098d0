//! Empty texels filled from those around them.

/// Colors and alpha, 255 where there is a color.
type Texels = Vec<[u8; 4]>;

/// Gives every empty texel a color: level by level of half the sides, the means of known colors, then back from the
/// coarsest level, so that no coarser picture of the texture mixes in anything that is not on the surface.
pub fn fill(texels: &mut Texels, size: usize) {
    if size <= 1 {
        return;
    }
    let half = size.div_ceil(2);
    let mut coarse: Texels = (0..half * half).map(|i| mean(texels, size, 2 * (i % half), 2 * (i / half))).collect();
    fill(&mut coarse, half);
    for (i, texel) in texels.iter_mut().enumerate().filter(|(_, texel)| texel[3] == 0) {
        *texel = coarse[i / size / 2 * half + i % size / 2];
    }
}

/// The mean color of the texels there are among four.
fn mean(texels: &Texels, size: usize, left: usize, top: usize) -> [u8; 4] {
    let places = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[x, y]| [left + x, top + y]);
    let there = places.into_iter().filter(|[x, y]| *x < size && *y < size).map(|[x, y]| texels[y * size + x]);
    let (mut sum, mut count) = ([0_u32; 3], 0);
    for texel in there.filter(|texel| texel[3] > 0) {
        (0..3).for_each(|c| sum[c] += u32::from(texel[c]));
        count += 1;
    }
    if count == 0 {
        return [0; 4];
    }
    let [r, g, b] = sum.map(|c| ((c + count / 2) / count) as u8);
    [r, g, b, 255]
}
