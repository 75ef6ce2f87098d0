//! exp, tanh and erf with some thirty digits, to measure the last digits of `f64` with: unevaluated sums of two numbers
//! (Dekker, Numerische Mathematik 18, 1971), and plain series.

/// A number as the sum of two, the second at most half a unit in the last place of the first.
#[derive(Clone, Copy, Debug)]
pub struct Twofold(pub f64, pub f64);

fn two_sum(a: f64, b: f64) -> Twofold {
    let s = a + b;
    let t = s - a;
    Twofold(s, (a - (s - t)) + (b - t))
}

impl Twofold {
    fn add(self, o: Self) -> Self {
        let Self(high, low) = two_sum(self.0, o.0);
        two_sum(high, low + self.1 + o.1)
    }

    fn neg(self) -> Self {
        Self(-self.0, -self.1)
    }

    fn mul(self, o: Self) -> Self {
        let high = self.0 * o.0;
        let low = self.0.mul_add(o.0, -high) + (self.0 * o.1 + self.1 * o.0);
        two_sum(high, low)
    }

    fn div(self, o: Self) -> Self {
        let first = self.0 / o.0;
        let rest = self.add(o.mul(Self(-first, 0.0)));
        let second = rest.0 / o.0;
        let rest = rest.add(o.mul(Self(-second, 0.0)));
        two_sum(first, second).add(Self(rest.0 / o.0, 0.0))
    }

    /// Times 2^n.
    fn scaled(self, n: i32) -> Self {
        // In two steps: 2^n alone may be out of range.
        let (a, b) = (f64::from(n / 2).exp2(), f64::from(n - n / 2).exp2());
        Self(self.0 * a * b, self.1 * a * b)
    }
}

const LN_2: Twofold = Twofold(std::f64::consts::LN_2, 2.319_046_813_846_299_6e-17);
const TWO_OVER_SQRT_PI: Twofold = Twofold(std::f64::consts::FRAC_2_SQRT_PI, 1.533_545_961_316_588e-17);

/// e^x - 1 for |x| < 1/2, by its series.
fn expm1(x: Twofold) -> Twofold {
    let (mut sum, mut term) = (x, x);
    for k in 2..30 {
        term = term.mul(x).div(Twofold(f64::from(k), 0.0));
        sum = sum.add(term);
    }
    sum
}

/// e^x.
pub fn exp(x: f64) -> Twofold {
    let n = (x / std::f64::consts::LN_2).round().clamp(-3000.0, 3000.0);
    let r = Twofold(x, 0.0).add(LN_2.mul(Twofold(-n, 0.0)));
    if r.0.abs() > 0.5 {
        return Twofold(if x > 0.0 { f64::INFINITY } else { 0.0 }, 0.0);
    }
    expm1(r).add(Twofold(1.0, 0.0)).scaled(n as i32)
}

/// tanh x = (e^2x - 1) / (e^2x + 1).
pub fn tanh(x: f64) -> Twofold {
    if x.abs() > 30.0 {
        return Twofold(1.0_f64.copysign(x), 0.0);
    }
    let (one, e) = (Twofold(1.0, 0.0), if x.abs() < 0.2 { Twofold(0.0, 0.0) } else { exp(2.0 * x) });
    if x.abs() < 0.2 {
        let e = expm1(Twofold(2.0 * x, 0.0));
        return e.div(e.add(Twofold(2.0, 0.0)));
    }
    e.add(one.neg()).div(e.add(one))
}

/// erf x by its alternating series up to 4, which loses seven of the digits there; beyond, 1 less the continued
/// fraction of erfc.
pub fn erf(x: f64) -> Twofold {
    let a = x.abs();
    let value = if a < 4.0 {
        let square = Twofold(a, 0.0).mul(Twofold(-a, 0.0));
        let (mut power, mut sum) = (Twofold(a, 0.0), Twofold(a, 0.0));
        for k in 1..120 {
            power = power.mul(square).div(Twofold(f64::from(k), 0.0));
            sum = sum.add(power.div(Twofold(f64::from(2 * k + 1), 0.0)));
        }
        sum.mul(TWO_OVER_SQRT_PI)
    } else {
        let fraction = (1..=120).rev().fold(0.0, |f, k| f64::from(k) / 2.0 / (a + f));
        Twofold(1.0, -(-a * a).exp() / ((a + fraction) * std::f64::consts::PI.sqrt()))
    };
    if x < 0.0 { value.neg() } else { value }
}

#[test]
fn agrees_with_published_digits() {
    // e and erf(1/2) to 32 digits: the second number holds the remainder of the first.
    let e = exp(1.0);
    assert!(e.0 == std::f64::consts::E && (e.1 - 1.445_646_891_729_250_2e-16).abs() < 1e-31, "{e:?}");
    let t = tanh(0.5);
    assert!((t.0 - 0.462_117_157_260_009_8).abs() < 1e-16, "{t:?}");
    let h = erf(0.5);
    assert!((h.0 - 0.520_499_877_813_046_5).abs() < 2e-16, "{h:?}");
}
