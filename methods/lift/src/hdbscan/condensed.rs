//! Clusters from the merges: large enough and the most stable.

use super::tree::Merge;

/// Clusters that are large enough, from the whole (0) down; a cluster's parent has a smaller number.
#[derive(Debug)]
pub(super) struct Condensed {
    /// Parent of each cluster; the whole is its own parent.
    parents: Vec<usize>,
    /// `sum over its points of 1 / distance at which they left - 1 / distance at which it appeared`.
    stabilities: Vec<f64>,
    /// The last cluster of each point.
    pub of_points: Vec<usize>,
}

/// Walks down from the last merge; a part of fewer than `smallest` points leaves its cluster without becoming one.
/// Merges at the same distance are one, so that the order of points does not matter.
pub(super) fn condensed(merges: &[Merge], count: usize, smallest: usize) -> Condensed {
    let size = |part: usize| if part < count { 1 } else { merges[part - count].size };
    // Density is 1 / distance: finite even for points in the same place.
    let longest = merges.last().map_or(0.0, |merge| merge.distance).max(f64::MIN_POSITIVE / f64::EPSILON);
    let mut clusters = Condensed { parents: vec![0], stabilities: vec![0.0], of_points: vec![0; count] };
    let mut births = vec![0.0];
    let mut open = vec![(count + merges.len() - 1, 0)];
    while let Some((whole, cluster)) = open.pop() {
        let distance = merges[whole - count].distance;
        let density = 1.0 / distance.max(1e-12 * longest);
        let parts = parts_of(whole, |part| part >= count && merges[part - count].distance == distance, merges, count);
        let split = parts.iter().filter(|part| size(**part) >= smallest).count() > 1;
        for part in parts {
            let points = size(part);
            if points >= smallest && !split {
                open.push((part, cluster));
                continue;
            }
            clusters.stabilities[cluster] += (density - births[cluster]) * points as f64;
            if points >= smallest {
                open.push((part, births.len()));
                clusters.parents.push(cluster);
                clusters.stabilities.push(0.0);
                births.push(density);
            } else {
                let points = parts_of(part, |part| part >= count, merges, count);
                points.into_iter().for_each(|point| clusters.of_points[point] = cluster);
            }
        }
    }
    clusters
}

/// Parts of a whole, with the parts selected by `falls` split further.
fn parts_of(whole: usize, falls: impl Fn(usize) -> bool, merges: &[Merge], count: usize) -> Vec<usize> {
    let (mut open, mut parts) = (vec![whole], Vec::new());
    while let Some(part) = open.pop() {
        if falls(part) {
            open.extend(merges[part - count].parts);
        } else {
            parts.push(part);
        }
    }
    parts
}

impl Condensed {
    /// True for clusters with more excess of mass than their descendants together; never for the whole.
    pub fn chosen(&self) -> Vec<bool> {
        let count = self.parents.len();
        let (mut best, mut within) = (self.stabilities.clone(), vec![0.0; count]);
        let mut chosen = vec![true; count];
        for cluster in (1..count).rev() {
            // Descendants have larger numbers.
            if within[cluster] > best[cluster] {
                (chosen[cluster], best[cluster]) = (false, within[cluster]);
            }
            within[self.parents[cluster]] += best[cluster];
        }
        chosen[0] = false;
        for cluster in 1..count {
            // No descendant of a chosen cluster is chosen.
            let above = self.ancestors(self.parents[cluster]).any(|at| chosen[at]);
            chosen[cluster] &= !above;
        }
        chosen
    }

    /// A cluster and its ancestors.
    pub fn ancestors(&self, cluster: usize) -> impl Iterator<Item = usize> {
        let up = |at: &usize| (*at != 0).then(|| self.parents[*at]);
        std::iter::successors(Some(cluster), up)
    }
}
