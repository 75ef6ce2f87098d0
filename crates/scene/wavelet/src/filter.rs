//! The wavelets: orthonormal filters and the sizes they give.

use std::fmt;
use std::str::FromStr;

/// Most taps a filter has.
pub(crate) const MAX_TAPS: usize = 4;

/// An orthonormal wavelet.
///
/// ```
/// use weaver_wavelet::Wavelet;
/// assert_eq!((Wavelet::Db2.output_len(448), Wavelet::Haar.output_len(17)), (225, 9));
/// assert_eq!("db2".parse(), Ok(Wavelet::Db2));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Wavelet {
    /// Two taps: means and differences of pairs of samples.
    Haar,
    /// Daubechies' wavelet with four taps and two vanishing moments, whose details vanish on linear ramps.
    #[default]
    Db2,
}

/// (1 - sqrt 3) / (4 sqrt 2) and so on: the taps of db2 in the order in which they meet the signal.
const DB2_LOW: [f64; 4] =
    [0.482_962_913_144_534_16, 0.836_516_303_737_807_9, 0.224_143_868_042_013_4, -0.129_409_522_551_260_37];
const HAAR_LOW: [f64; 2] = [std::f64::consts::FRAC_1_SQRT_2; 2];

impl Wavelet {
    /// Number of filter taps, L.
    pub fn taps(self) -> usize {
        self.low().len()
    }

    /// The low-pass analysis filter, in the order in which its taps meet the signal (the reverse of the usual listing).
    pub fn low(self) -> &'static [f64] {
        match self {
            Self::Haar => &HAAR_LOW,
            Self::Db2 => &DB2_LOW,
        }
    }

    /// Tap `j` of the high-pass analysis filter: the quadrature mirror of the low-pass one.
    pub fn high(self, j: usize) -> f64 {
        let mirrored = self.low()[self.taps() - 1 - j];
        if j.is_multiple_of(2) { mirrored } else { -mirrored }
    }

    /// Coefficients of a signal of `n` samples: floor((n + L - 1) / 2).
    pub fn output_len(self, n: usize) -> usize {
        (n + self.taps() - 1) / 2
    }
}

impl fmt::Display for Wavelet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Haar => "haar",
            Self::Db2 => "db2",
        })
    }
}

/// A name that no wavelet has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownWavelet(String);

impl fmt::Display for UnknownWavelet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "wavelet: expected \"haar\" or \"db2\", found \"{}\"", self.0)
    }
}

impl std::error::Error for UnknownWavelet {}

impl FromStr for Wavelet {
    type Err = UnknownWavelet;
    fn from_str(name: &str) -> Result<Self, UnknownWavelet> {
        match name {
            "haar" => Ok(Self::Haar),
            "db2" => Ok(Self::Db2),
            _ => Err(UnknownWavelet(name.to_owned())),
        }
    }
}
