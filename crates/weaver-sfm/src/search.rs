//! Scenes that explain photos, of which the best is taken.

use crate::bundle::Bundle;
use crate::evidence::{Evidence, Trust};
use crate::features::Features;
use crate::focal;
use crate::grow::{Grown, beginnings};
use crate::lenses::{Taken, USUAL, tau};
use crate::pairs::{self, Pair, Pairs, linked};
use crate::passes::{Pass, near};
use crate::photo::{EstimateSettings, Photo};
use crate::retrieval::candidates;

/// Points that a photo with a camera must see at least.
const LEAST_SEEN: usize = 25;
/// Focal lengths that are tried where nothing is known.
const FOCAL_LENGTHS: usize = 2;
/// Photos of which many beginnings can be tried.
const FEW: usize = 8;
/// Beginnings that are tried, and the most photos of which more than one is where the first reaches all.
const BEGINNINGS: usize = 6;
const SEVERAL: usize = 12;
/// The part of what another scene explains that one explains from which on they confirm each other.
const ALIKE: f64 = 0.9;
/// The share of the matches of a pair that must agree where there are many photos. What leads one scene astray need not lead the
/// other.
const CERTAIN: [f64; 2] = [0.5, 0.65];
/// Rotations farther apart than this are different, radians; explanations are in which one of so many photos differs.
const DIFFERENT: f64 = 0.1;
const ONE_IN: usize = 8;

/// What was found.
pub(crate) struct Scene {
    /// Cameras and points, and which photos have a place.
    pub found: Option<(Bundle, Vec<bool>)>,
    pub pairs: Pairs,
    /// How much the best explanation explains that is different, over the one that was taken.
    pub rival: f64,
}

/// What is tried.
pub(crate) struct Search<'a> {
    taken: &'a [Taken],
    features: &'a [Features],
    photos: &'a [&'a Photo<'a>],
    settings: &'a EstimateSettings,
    pairs: Pairs,
    /// The scenes that were grown.
    found: Vec<Grown>,
}

impl<'a> Search<'a> {
    pub fn new(taken: &'a [Taken], photos: &'a [&'a Photo<'a>], features: &'a [Features], settings: &'a EstimateSettings) -> Self {
        let candidates = candidates(features, &vec![true; taken.len()], settings.candidates, settings.sequence);
        let matched = pairs::matched(features, &candidates);
        Self { taken, features, photos, settings, pairs: Pairs { matched, posed: Vec::new() }, found: Vec::new() }
    }

    /// The scene that explains most.
    pub fn scene(mut self) -> Scene {
        self.run();
        let mut refined: Vec<Grown> = Vec::new();
        for i in self.candidates() {
            let mut grown = self.found[i].clone();
            if let Ok(text) = std::env::var("TRUTHCAMS").map(|f| std::fs::read_to_string(f).unwrap()) {
                use weaver_geometry::glam::{DMat3, DVec3};
                for (i, l) in text.lines().enumerate() {
                    let v: Vec<f64> = l.split(' ').map(|x| x.parse().unwrap()).collect();
                    let r = DMat3::from_cols_array(&std::array::from_fn(|k| v[k]));
                    let c = DVec3::new(v[9], v[10], v[11]);
                    let bundle = &mut grown.bundle;
                    bundle.cameras[i].pose = weaver_geometry::Pose::new(r, -(r * c));
                    grown.placed[i] = true;
                    let f = v[12] * crate::bundle::longer(&bundle.cameras[i]);
                    let l = bundle.lens_of[i];
                    bundle.lenses[l].log_focal = (f / bundle.cameras[i].intrinsics.fx).ln();
                }
            }
            if crate::knob("REPLACE", 1.0) > 0.0 { self.reconsider(&mut grown); }
            self.refine(&mut grown.bundle, &grown.placed);
            let seen = grown.bundle.seen();
            grown.placed.iter_mut().zip(seen).for_each(|(placed, seen)| *placed &= seen >= LEAST_SEEN);
            grown.bundle.observations.retain(|o| grown.placed[o.camera]);
            grown.bundle.finish();
            let before = grown.support;
            grown.support = crate::grow::explained(&grown.bundle);
            if std::env::var("DIAG").is_ok() { println!("    refined {} placed, support {before:.0} -> {:.0}, err {:.3}", grown.value().0, grown.support, grown.bundle.median_error()); }
            refined.push(grown);
        }
        let best = (0..refined.len()).reduce(|a, b| if refined[b].value() > refined[a].value() { b } else { a });
        let Some(best) = best else { return Scene { found: None, pairs: self.pairs, rival: 0.0 } };
        let turn = crate::knob("TURNED", 2.0f64).to_radians();
        let others = refined.iter().filter(|other| refined[best].differs(other, turn));
        let rival = others.map(|other| other.support / refined[best].support).fold(0.0, f64::max);
        let Grown { bundle, placed, .. } = refined.swap_remove(best);
        if std::env::var("DIAG").is_ok() { self.ties(&bundle, &placed); }
        Scene { found: Some((bundle, placed)), pairs: self.pairs, rival }
    }

    fn reconsider(&self, grown: &mut Grown) {
        let n = grown.placed.iter().filter(|p| **p).count();
        if n < 3 || n > 64 { return; }
        let absent = vec![false; self.taken.len()];
        let tracks = linked(self.features, &self.pairs.posed);
        let all = Evidence { features: self.features, pairs: &self.pairs.posed, tracks: &tracks, absent: &absent, trust: Trust::POINTS };
        let free: Vec<bool> = grown.bundle.lenses.iter().map(|lens| lens.free_focal).collect();
        for photo in (0..grown.placed.len()).filter(|i| grown.placed[*i]).collect::<Vec<_>>() {
            let mut other = grown.clone();
            other.placed[photo] = false;
            if other.bundle.fixed[photo] { let next = (0..n).find(|i| other.placed[*i]).unwrap(); other.bundle.fixed[photo] = false; other.bundle.fixed[next] = true; }
            let Some(pose) = other.replaced(&all, photo, n <= SEVERAL) else { if std::env::var("DIAG").is_ok() { println!("    replaced {photo}: nowhere"); } continue };
            // in the frame of the rest
            let rel = |b: &Bundle, p: &weaver_geometry::Pose| { let o = (0..other.placed.len()).find(|i| other.placed[*i]).unwrap(); p.relative_to(&b.cameras[o].pose) };
            let (was, is) = (rel(&grown.bundle, &grown.bundle.cameras[photo].pose), rel(&other.bundle, &pose));
            let turn = was.angle_to(&is).to_degrees();
            let (mut value, mut text) = (0.0, false);
            if turn > crate::knob("REPLACED", 0.4) {
                other.bundle.cameras[photo].pose = pose;
                other.placed[photo] = true;
                other.bundle.free_focal(&free, &other.placed);
                other.settle(&all);
                other.bundle.lenses.iter_mut().zip(&free).for_each(|(lens, free)| lens.free_focal = *free);
                value = other.support;
                text = true;
            }
            if std::env::var("DIAG").is_ok() && text { println!("    replaced {photo}: {turn:.2} deg, {:.0} -> {value:.0}", grown.support); }
            if value > crate::knob("BETTER", 1.005) * grown.support && other.placed[photo] { *grown = other; }
        }
    }

    fn ties(&self, bundle: &Bundle, placed: &[bool]) {
        let n = placed.len();
        let bottleneck = |mut edges: Vec<(f64, [usize; 2])>| {
            edges.sort_by(|a, b| b.0.total_cmp(&a.0));
            let mut group: Vec<usize> = (0..n).collect();
            let mut parts = placed.iter().filter(|p| **p).count();
            for (w, [a, b]) in edges {
                let (ga, gb) = (group[a], group[b]);
                if ga != gb { group.iter_mut().for_each(|g| if *g == gb { *g = ga }); parts -= 1; if parts == 1 { return w; } }
            }
            0.0
        };
        let both = |p: &&Pair| p.photos.iter().all(|i| placed[*i]);
        let by = |share: f64| bottleneck(self.pairs.posed.iter().filter(both).filter(|p| p.share >= share).map(|p| (p.matches.len() as f64, p.photos)).collect());
        let agreed = bundle.agreed();
        let mut sees = vec![std::collections::BTreeSet::new(); n];
        bundle.observations.iter().filter(|o| agreed[o.point]).for_each(|o| { sees[o.camera].insert(o.point); });
        let mut shared = vec![];
        for a in 0..n { for b in 0..a { if placed[a] && placed[b] { shared.push((sees[a].intersection(&sees[b]).count() as f64, [a, b])); } } }
        let [agree, all] = self.pairs.posed.iter().filter(both).filter(|p| p.matches.len() >= 20 && p.share >= 0.5).fold([0, 0], |[x, y], p| {
            let g = crate::place::agreeing_pub(self.features, p, &p.photos.map(|i| bundle.camera(i)));
            [x + usize::from(2 * g < p.matches.len()), y + 1]
        });
        println!("TIES {} {} {} {} contradicted {agree} of {all}", by(0.0), by(0.35), by(0.5), bottleneck(shared));
    }

    /// Scenes that are different and explain nearly as much as the best, that first.
    fn candidates(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.found.len()).collect();
        order.sort_by(|a, b| self.found[*b].value().partial_cmp(&self.found[*a].value()).unwrap());
        let mut kept: Vec<usize> = Vec::new();
        let turn = crate::knob("APART", 0.05);
        for i in order {
            let best = kept.first().map_or(i, |i| *i);
            let near = self.found[i].value().0 as f64 >= 0.9 * self.found[best].value().0 as f64 && self.found[i].support >= crate::knob("NEARLY", 0.6) * self.found[best].support;
            if near && kept.len() < crate::knob("KEPT", 4.0) as usize && kept.iter().all(|k| self.found[*k].differs(&self.found[i], turn)) { kept.push(i); }
        }
        kept
    }

    /// Grows scenes.
    fn run(&mut self) {
        let few = self.taken.len() <= FEW;
        let tau = tau(self.taken);
        let mut factors = self.focal_lengths(tau);
        let mut tried: Vec<f64> = Vec::new();
        for _ in 0..crate::knob("ROUNDS", 3.0) as usize {
            let mut starts = Vec::new();
            for factor in factors.drain(..) {
                let before = self.found.len();
                let bundle = self.settings.bundle(self.taken, factor);
                let posed = pairs::posed(self.features, &bundle.cameras, &self.pairs.matched, tau);
                if let Ok(text) = std::env::var("SEECAMS").map(|f| std::fs::read_to_string(f).unwrap()) {
                    use weaver_geometry::glam::DMat3;
                    let rs: Vec<DMat3> = text.lines().map(|l| { let v: Vec<f64> = l.split(' ').map(|x| x.parse().unwrap()).collect(); DMat3::from_cols_array(&std::array::from_fn(|k| v[k])) }).collect();
                    println!("    focal factor {factor:.3}");
                    for p in &posed { let [a,b] = p.photos; let t = rs[b]*rs[a].transpose(); let e = |q: &weaver_geometry::Pose| weaver_geometry::Pose::new(q.rotation, Default::default()).angle_to(&weaver_geometry::Pose::new(t, Default::default())).to_degrees();
                        println!("    {a} {b}: {} matches share {:.2} parallax {:.1} turned {:.2} err {:.1} rival {:.1}", p.matches.len(), p.share, p.parallax.to_degrees(), p.turned, e(&p.pose), p.rival.as_ref().map_or(f64::NAN, e)); }
                }
                // Among many photos, pairs that are chance do more harm than those that are doubtful do good.
                let certain: &[f64] = if few { &[0.0] } else { &CERTAIN };
                certain.iter().for_each(|share| self.grow(&bundle, &posed, *share));
                self.pairs.posed = posed;
                tried.push(factor);
                starts.extend(vec![factor; self.found.len() - before]);
            }
            if self.taken.len() > SEVERAL { return; }
            let base = self.found.len() - starts.len();
            let value = |i: usize| self.found[i].value();
            let Some(best) = (0..self.found.len()).reduce(|a, b| if value(b) > value(a) { b } else { a }) else { return };
            if best < base { return; }
            let grown = &self.found[best];
            let Some(lens) = (0..grown.placed.len()).find(|i| grown.placed[*i]).map(|i| &grown.bundle.lenses[grown.bundle.lens_of[i]]) else { return };
            let found = starts[best - base] * lens.log_focal.exp();
            if tried.iter().any(|t| (t / found).ln().abs() < crate::knob("NEARF", 0.04)) { return; }
            if std::env::var("DIAG").is_ok() { println!("    again with {found:.3} after {tried:?}"); }
            factors = vec![found];
        }
    }

    /// Grows scenes by pairs of which at least this share of the matches agrees.
    fn grow(&mut self, bundle: &Bundle, posed: &[Pair], share: f64) {
        let few = self.taken.len() <= FEW;
        let absent = vec![false; self.taken.len()];
        let certain: Vec<Pair> = posed.iter().filter(|pair| few || pair.certain(share)).cloned().collect();
        let (all_tracks, tracks) = (linked(self.features, posed), linked(self.features, &certain));
        let evidence = Evidence {
            features: self.features,
            pairs: &certain,
            tracks: &tracks,
            absent: &absent,
            trust: Trust::PAIRS,
        };
        let all = Evidence { pairs: posed, tracks: &all_tracks, trust: Trust::POINTS, ..evidence };
        let first = self.found.len();
        let mut tried = 0;
        for from in beginnings(&evidence).into_iter().map(|i| &certain[i]) {
            // Of many photos, the next beginning is in what the others did not reach.
            let reached = |grown: &Grown| from.photos.iter().all(|p| grown.placed[*p]);
            let grown = &self.found[first..];
            if tried == BEGINNINGS || confirmed(grown) || self.taken.len() > SEVERAL && grown.iter().any(reached) {
                continue;
            }
            tried += 1;
            for pose in std::iter::once(&from.pose).chain(&from.rival) {
                let mut grown = Grown::new(bundle.clone(), from.photos, pose);
                grown.grow(&evidence);
                if !few {
                    grown.grow(&all);
                }
                self.found.push(grown);
            }
        }
    }

    /// Matches and adjusts by turns, until all that photos share is found.
    fn refine(&self, bundle: &mut Bundle, placed: &[bool]) {
        let free: Vec<bool> = bundle.lenses.iter().map(|lens| lens.free_focal).collect();
        bundle.free_focal(&free, placed);
        let missing: Vec<bool> = placed.iter().map(|placed| !placed).collect();
        let mut near = near(bundle, placed, self.settings.candidates);
        if crate::knob("UNION", 1.0) > 0.0 {
        // What pairs say holds together what looks another way.
        let posed = self.pairs.posed.iter().filter(|pair| pair.certain(0.5)).map(|pair| pair.photos);
        near.extend(posed.filter(|pair| pair.iter().all(|photo| placed[*photo])));
        near.sort_unstable();
        near.dedup();
        }
        let [first, last] = Pass::FINE;
        for _ in 0..crate::knob("MEDIUM", 0.0) as usize { bundle.pass(self.features, &near, &missing, &Pass::MEDIUM); }
        for _ in 0..crate::knob("FIRST", 1.0) as usize { bundle.pass(self.features, &near, &missing, &first); }
        let early = crate::knob("EARLY", 1.0) as usize;
        self.align(bundle, early);
        if bundle.free_distortion(self.settings.distortion, placed) {
            // What was thought wrong at the margins may be right.
            bundle.pass(self.features, &near, &missing, &first);
        }
        bundle.pass(self.features, &near, &missing, &last);
        bundle.finish();
        self.align(bundle, crate::knob("ALIGN", 2.0) as usize);
        if std::env::var("DIAG").is_ok() { println!("    k1 {} k2 {}", bundle.lenses[0].k1, bundle.lenses[0].k2); }
    }

    fn align(&self, bundle: &mut Bundle, times: usize) {
        for _ in 0..times {
            bundle.align(self.photos);
            bundle.adjust(2.0, 40);
            bundle.leave_out(6.0);
            bundle.adjust(1.0, 40);
            bundle.leave_out(3.0);
            bundle.finish();
            if std::env::var("DIAG").is_ok() { println!("    after {} refined {} of {}", bundle.median_error(), bundle.observations.iter().filter(|o| o.deviation < 1.0).count(), bundle.observations.len()); }
        }
    }

    /// Focal lengths to begin with, over the longer side: what is known, or those that pairs vote for.
    fn focal_lengths(&self, tau: f64) -> Vec<f64> {
        if crate::knob("FOCAL", 0.0) > 0.0 { return vec![crate::knob("FOCAL", 0.0)]; }
        if self.taken.iter().any(|t| t.focal.is_some()) {
            return vec![USUAL];
        }
        let usual = self.settings.bundle(self.taken, USUAL).cameras;
        let voted = focal::voted(self.features, &usual, &self.pairs.matched, tau);
        let mut voted: Vec<f64> = voted.into_iter().map(|f| f * USUAL).collect();
        voted.truncate(FOCAL_LENGTHS);
        if voted.is_empty() { vec![USUAL] } else { voted }
    }
}

/// Whether two scenes from different beginnings, and no better one, say the same.
fn confirmed(found: &[Grown]) -> bool {
    let Some(best) = (0..found.len()).reduce(|a, b| if found[b].value() > found[a].value() { b } else { a }) else {
        return false;
    };
    let alike = |other: &Grown| {
        other.value().0 == found[best].value().0
            && other.support > ALIKE * found[best].support
            && !found[best].differs(other, DIFFERENT)
    };
    (0..found.len()).any(|i| i != best && alike(&found[i]))
}

impl Grown {
    /// Photos with a place, then how well they explain each other.
    fn value(&self) -> (usize, f64) {
        (self.placed.iter().filter(|placed| **placed).count(), self.support)
    }

    /// Whether enough photos are turned another way relative to the rest.
    fn differs(&self, other: &Self, turn_: f64) -> bool {
        let both: Vec<usize> = (0..self.placed.len()).filter(|i| self.placed[*i] && other.placed[*i]).collect();
        let turn =
            |bundle: &Bundle, i: usize, from: usize| bundle.cameras[i].pose.relative_to(&bundle.cameras[from].pose);
        let turned =
            |i: usize, from: usize| turn(&self.bundle, i, from).angle_to(&turn(&other.bundle, i, from)) > turn_;
        // Seen from the photo that agrees with most.
        let fewest = both.iter().map(|from| both.iter().filter(|i| turned(**i, *from)).count()).min();
        fewest.is_some_and(|fewest| fewest > 0 && fewest * ONE_IN >= both.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::glam::{DMat3, DVec3};
    use weaver_geometry::{Camera, Intrinsics, Pose};

    /// Sixteen photos, of which these are turned, in a world that is turned.
    fn grown(turned: &[usize], world: f64) -> Grown {
        let camera = |i: usize| {
            let own = if turned.contains(&i) { 2.0 * DIFFERENT } else { 0.0 };
            let rotation = DMat3::from_rotation_y(own + 0.05 * i as f64) * DMat3::from_rotation_x(world);
            let intrinsics = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.5, cy: 0.5 };
            Camera { pose: Pose::new(rotation, DVec3::ZERO), intrinsics, width: 1, height: 1 }
        };
        let bundle = Bundle { cameras: (0..16).map(camera).collect(), ..Bundle::default() };
        Grown { bundle, placed: vec![true; 16], support: 1.0, agreeing: [1, 1] }
    }

    #[test]
    fn explanations_differ_by_photos_and_not_by_their_world() {
        let first = grown(&[], 0.0);
        assert!(!first.differs(&grown(&[], 0.7), DIFFERENT));
        assert!(!first.differs(&grown(&[0], 0.7), DIFFERENT), "one of many");
        assert!(first.differs(&grown(&[0, 9], 0.7), DIFFERENT));
    }
}
