//! Products of bytes against a slow twin: all are exact.

use weaver_kernels::byte_products::{LARGEST_SQUARE, TopTwo, chosen_products, top_products};
use weaver_kernels::random::Stream;

/// Vectors of random bytes, as long as they may be; some are one another's doubles, some lie along two bytes alone, and
/// some are 0.
fn vectors(n: usize, depth: usize, seed: u64) -> Vec<u8> {
    let mut all = Vec::new();
    for i in 0..n {
        let stream = Stream::new(seed, (i / 3 * 3 + i % 3 / 2) as u64, "test.bytes");
        let kind = stream.uniform::<f64>(1000);
        let mut x: Vec<f64> = (0..depth as u64).map(|k| stream.uniform::<f64>(k).powi(3)).collect();
        if kind < 0.1 {
            x.fill(0.0);
        } else if kind < 0.2 {
            x.iter_mut().enumerate().for_each(|(k, x)| *x = f64::from(u8::from(k < 2)));
        }
        let length = x.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-9);
        let mut bytes: Vec<u8> = x.iter().map(|x| (x / length * 255.9).min(127.0) as u8).collect();
        while bytes.iter().map(|b| u32::from(*b).pow(2)).sum::<u32>() > LARGEST_SQUARE {
            bytes.iter_mut().for_each(|b| *b = b.saturating_sub(1));
        }
        all.extend(bytes);
    }
    all
}

fn product(a: &[u8], b: &[u8]) -> u32 {
    a.iter().zip(b).map(|(a, b)| u32::from(*a) * u32::from(*b)).sum()
}

fn slow(depth: usize, a: &[u8], b: &[u8]) -> (Vec<TopTwo>, Vec<u32>) {
    let mut columns = vec![0; b.len() / depth];
    let row = |a: &[u8]| {
        let products: Vec<u32> = b.chunks_exact(depth).map(|b| product(a, b)).collect();
        columns.iter_mut().zip(&products).for_each(|(c, p): (&mut u32, _)| *c = *p.max(c));
        let first = products.iter().copied().max().unwrap_or(0);
        let column = products.iter().position(|p| *p == first).unwrap_or(0);
        let second = products.iter().enumerate().filter(|(i, _)| *i != column).map(|(_, p)| *p).max().unwrap_or(0);
        TopTwo { column: column as u32, first, second }
    };
    let rows = a.chunks_exact(depth).map(row).collect();
    (rows, columns)
}

#[test]
fn largest_products_are_those_of_the_slow_twin() {
    let mut ties = 0;
    for (seed, (n, m, depth)) in
        [(1, 1, 32), (3, 17, 64), (64, 16, 128), (65, 33, 128), (130, 257, 128), (9, 40, 160), (5, 0, 32), (0, 5, 32)]
            .into_iter()
            .enumerate()
    {
        let (a, b) = (vectors(n, depth, seed as u64), vectors(m, depth, 100 + seed as u64));
        let (mut rows, mut columns) = (vec![TopTwo { column: 7, first: 7, second: 7 }; n], vec![7; m]);
        top_products(depth, &a, &b, &mut rows, &mut columns);
        assert_eq!((rows.clone(), columns), slow(depth, &a, &b), "{n} x {m} x {depth}");
        ties += rows.iter().filter(|r| r.first == r.second && r.first > 0).count();
    }
    assert!(ties > 10, "doubles were to be told apart: {ties}");
}

/// More vectors than the numbers beside products can count.
#[test]
fn columns_beyond_sixteen_bits_are_found() {
    let (depth, m) = (32, (1 << 16) + 20);
    let mut b = vec![1; m * depth];
    for (at, byte) in [(5, 9), (70, 8), (m - 3, 10), (m - 1, 10)] {
        b[at * depth..][..depth].fill(byte);
    }
    let (mut rows, mut columns) = ([TopTwo::default()], vec![0; m]);
    top_products(depth, &vec![2; depth], &b, &mut rows, &mut columns);
    assert_eq!(rows[0], TopTwo { column: m as u32 - 3, first: 640, second: 640 });
    assert_eq!((columns[5], columns[6], columns[m - 1]), (576, 64, 640));
}

#[test]
fn longest_vectors_do_not_overflow() {
    // Squares of 65532 and 65025, in few bytes and in many.
    for (byte, count) in [(127, 4), (22, 128), (11, 512)] {
        let mut vector = vec![0; 512];
        vector[..count].fill(byte);
        let square = product(&vector, &vector);
        assert!(square > 60_000 && square <= LARGEST_SQUARE, "{square}");
        let (mut rows, mut columns) = ([TopTwo::default()], [0]);
        top_products(512, &vector, &vector, &mut rows, &mut columns);
        assert_eq!((rows[0].first, columns[0]), (square, square));
        let mut out = [0; 5];
        chosen_products(&vector, &vector, &[0; 5], &mut out);
        assert_eq!(out, [square; 5]);
    }
}

#[test]
#[should_panic(expected = "a square above")]
fn too_long_vectors_are_refused() {
    let long = [127; 32];
    top_products(32, &long, &[0; 32], &mut [TopTwo::default()], &mut [0]);
}

#[test]
fn chosen_products_are_those_of_the_slow_twin() {
    for depth in [32, 128, 160] {
        let (query, b) = (vectors(1, depth, 5), vectors(37, depth, 6));
        for n in 0..12 {
            let chosen: Vec<u32> = (0..n).map(|i| (i * 31 + 5) % 37).collect();
            let mut out = vec![7; n as usize];
            chosen_products(&query, &b, &chosen, &mut out);
            let expected: Vec<u32> =
                chosen.iter().map(|i| product(&query, &b[*i as usize * depth..][..depth])).collect();
            assert_eq!(out, expected);
        }
    }
}
