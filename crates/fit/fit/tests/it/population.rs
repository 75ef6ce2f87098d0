//! Changes of the number of Gaussians, against lists of rows.

use crate::scenes::cloud;
use proptest::prelude::*;
use weaver_fit::Population;
use weaver_geometry::sh::coefficients;

#[derive(Clone, Debug)]
enum Change {
    Retain(Vec<bool>),
    Duplicate(usize),
    Overwrite(usize, usize),
    Forget(usize),
    Raise(usize),
}

fn change() -> impl Strategy<Value = Change> {
    prop_oneof![
        prop::collection::vec(prop::bool::weighted(0.8), 40).prop_map(Change::Retain),
        (0usize..40).prop_map(Change::Duplicate),
        (0usize..40, 0usize..40).prop_map(|(to, from)| Change::Overwrite(to, from)),
        (0usize..40).prop_map(Change::Forget),
        (0usize..4).prop_map(Change::Raise),
    ]
}

/// Values and moments of a Gaussian, parameter by parameter.
#[derive(Clone, Debug, PartialEq)]
struct Row {
    values: [Vec<f32>; 5],
    moments: [Vec<f32>; 5],
}

fn rows(population: &Population) -> Vec<Row> {
    let part = |values: &[f32], width: usize, n: usize| values[n * width..][..width].to_vec();
    let fields = population.fields().map(|(_, field)| field);
    (0..population.len())
        .map(|n| Row {
            values: fields.map(|f| part(&f.values, f.width(), n)),
            moments: fields.map(|f| [part(&f.first, f.width(), n), part(&f.second, f.width(), n)].concat()),
        })
        .collect()
}

/// A population whose every number is another one.
fn marked() -> Population {
    let mut population = Population::new(&cloud(12, 3));
    let mut next = 1.0;
    let Population { means, log_scales, quats, logits, sh, .. } = &mut population;
    for field in [means, log_scales, quats, logits, sh] {
        for array in [&mut field.values, &mut field.first, &mut field.second] {
            array.iter_mut().for_each(|x| {
                *x = next;
                next += 1.0;
            });
        }
    }
    population
}

impl Row {
    fn without_history(mut self) -> Self {
        self.moments.iter_mut().for_each(|m| m.fill(0.0));
        self
    }

    fn widened(mut self, width: usize) -> Self {
        let old = self.values[4].len();
        self.values[4].resize(width, 0.0);
        let mut moments = vec![0.0; 2 * width];
        moments[..old].copy_from_slice(&self.moments[4][..old]);
        moments[width..][..old].copy_from_slice(&self.moments[4][old..]);
        self.moments[4] = moments;
        self
    }
}

proptest! {
    #[test]
    fn fields_stay_in_step(changes in prop::collection::vec(change(), 0..30)) {
        let mut population = marked();
        let mut expected = rows(&population);
        for change in changes {
            let n = expected.len();
            match change {
                Change::Retain(keep) => {
                    let keep: Vec<bool> = (0..n).map(|i| keep[i % keep.len()]).collect();
                    population.retain(&keep);
                    let mut keep = keep.into_iter();
                    expected.retain(|_| keep.next() == Some(true));
                }
                _ if n == 0 => {}
                Change::Duplicate(i) => {
                    prop_assert_eq!(population.duplicate(i % n), n);
                    expected.push(expected[i % n].clone().without_history());
                }
                Change::Overwrite(to, from) => {
                    population.overwrite(to % n, from % n);
                    expected[to % n] = expected[from % n].clone().without_history();
                }
                Change::Forget(i) => {
                    population.forget(i % n);
                    expected[i % n] = expected[i % n].clone().without_history();
                }
                Change::Raise(degree) => {
                    let raised = degree.max(population.degree());
                    population.raise_degree(degree);
                    prop_assert_eq!(population.degree(), raised);
                    let width = 3 * coefficients(raised);
                    expected = expected.into_iter().map(|row| row.widened(width)).collect();
                }
            }
            prop_assert_eq!(rows(&population), expected.clone());
        }
        prop_assert!(population.to_gaussians(3).lengths_agree());
    }
}
