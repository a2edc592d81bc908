//! All hits of each ray of a case in rational arithmetic, how often it crosses a surface, and what a walk finds.
//!
//! **Lists.** A list has every triangle that the ray hits within its limits, by the exact t, those at exactly the same
//! t by number; t, u and v are the floats nearest to the exact ones. It is judged so whatever the triangle test: a
//! tolerance for whole lists would have to say which of the hits that lie near each other may change places.
//!
//! **Crossings.** Those of the ray that starts at its origin + (h, h^2, h^3) instead, with an h less than any number
//! (Edelsbrunner and Mücke, "Simulation of Simplicity", ACM Transactions on Graphics 9(1), 1990). Hits at edges and
//! vertices at one exact t are one meeting. It counts once when the moved ray crosses an odd number of its triangles;
//! each hit inside of a triangle counts. Which triangles the moved ray crosses is taken from the weights of three moved
//! lines (`exact.rs`), not from the formula of `src/crossings.rs`, which this judges.
//!
//! **Walks.** A walk asks for the closest hit, sets `t_min` to the float that follows its rounded t, and asks again,
//! until there is a miss. Let t be the exact t of a hit, r the float nearest to it, and n the float that follows r.
//! Then t < n: else n would be nearer to t than r is. Limits are compared with exact t's, so the hit itself is before
//! the new limit, and never comes again, whether it lies before or behind r. The next one is the first of the list
//! whose exact t is not below n. What lies from t to n, without n, is stepped over: the other hits at exactly t, and
//! those less than a float behind it. So the walk is known from the list.

use super::case::Case;
use super::exact::{Crossing, ExactTracer, Interval};
use super::judge::Fault;
use super::ratio::Ratio;
use raybrook::low_level::parallel;
use raybrook::low_level::shared::Hit;

/// A hit of a list.
struct Listed {
    hit: Hit,
    /// The largest float that is not above the exact t.
    floor: f32,
}

/// The exact answer for one ray.
#[derive(Default)]
struct List {
    hits: Vec<Listed>,
    crossings: u32,
}

/// The exact lists of a case.
pub struct Lists {
    of_rays: Vec<List>,
}

impl Lists {
    /// Lists the hits of all rays exactly, on all cores. Secondary rays have none.
    pub fn new(case: &Case) -> Lists {
        let tracer = ExactTracer::new(&case.mesh);
        Lists { of_rays: parallel::map_numbers(case.rays.len(), |i| list(&tracer, case, i)) }
    }

    /// All hits of ray `index`, rounded.
    pub fn list(&self, index: usize) -> Vec<Hit> {
        self.of_rays[index].hits.iter().map(|listed| listed.hit).collect()
    }

    /// What a walk along ray `index` finds, rounded.
    pub fn walk(&self, index: usize) -> Vec<Hit> {
        let mut near = f32::NEG_INFINITY;
        let mut walk = Vec::new();
        for Listed { hit, floor } in &self.of_rays[index].hits {
            // No float is between `floor` and the exact t: this compares the latter.
            if *floor >= near {
                walk.push(*hit);
                near = hit.t.next_up();
            }
        }
        walk
    }

    /// How often ray `index` crosses a surface.
    pub fn crossings(&self, index: usize) -> u32 {
        self.of_rays[index].crossings
    }
}

fn list(tracer: &ExactTracer, case: &Case, index: usize) -> List {
    let ray = &case.rays[index];
    let Some(line) = tracer.line(ray.origin.as_dvec3(), ray.direction.as_dvec3()) else { return List::default() };
    let all = tracer.all(&line, Interval { near: ray.t_min, far: ray.t_max, is_open: false });
    let mut crossings = 0;
    for meeting in all.chunk_by(|a, b| a.t == b.t) {
        let (seams, insides): (Vec<_>, Vec<_>) = meeting.iter().partition(|crossing| crossing.is_on_edge());
        let crosses = |crossing: &&&Crossing| {
            let corners = tracer.corners(crossing.primitive);
            corners.is_some_and(|corners| line.crosses_when_moved(corners))
        };
        crossings += insides.len() + seams.iter().filter(crosses).count() % 2;
    }
    List { hits: all.iter().map(listed).collect(), crossings: crossings as u32 }
}

fn listed(crossing: &Crossing) -> Listed {
    let t = crossing.t.to_f32();
    let is_above = Ratio::from_float(t.into()) > crossing.t;
    Listed {
        hit: Hit { t, u: crossing.u.to_f32(), v: crossing.v.to_f32(), primitive: crossing.primitive },
        floor: if is_above { t.next_down() } else { t },
    }
}

/// What is wrong with the hits that were found where `due` are due; first of all with their triangles.
pub(super) fn fault_of_list(found: &[Hit], due: &[Hit]) -> Option<Fault> {
    let triangles = |hits: &[Hit]| hits.iter().map(|hit| hit.primitive).collect::<Vec<_>>();
    let (mut of_found, mut of_due) = (triangles(found), triangles(due));
    if of_found == of_due {
        let differs = |is_off: fn(&Hit, &Hit) -> bool| found.iter().zip(due).any(|(found, due)| is_off(found, due));
        return match () {
            () if differs(|found, due| found.t != due.t) => Some(Fault::T),
            () if differs(|found, due| (found.u, found.v) != (due.u, due.v)) => Some(Fault::Weights),
            () => None,
        };
    }
    of_found.sort_unstable();
    of_due.sort_unstable();
    let lacks = |hits: &[u32], others: &[u32]| others.iter().any(|other| hits.binary_search(other).is_err());
    Some(match () {
        () if of_found.windows(2).any(|two| two[0] == two[1]) => Fault::Twice,
        () if lacks(&of_found, &of_due) => Fault::Miss,
        () if lacks(&of_due, &of_found) => Fault::False,
        () => Fault::Order,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stress::{Kind, Question};

    const SEED: u64 = 5;

    fn hit(primitive: u32, t: f32) -> Hit {
        Hit { t, u: 0.25, v: 0.5, primitive }
    }

    #[test]
    fn every_fault_of_a_list_is_told() {
        let due = [hit(3, 1.0), hit(1, 2.0), hit(2, 2.0)];
        let off = Hit { v: 0.5f32.next_up(), ..due[2] };
        let cases: [(&[Hit], Option<Fault>); 9] = [
            (&due, None),
            (&due[..2], Some(Fault::Miss)),
            (&[], Some(Fault::Miss)),
            (&[due[0], due[1], hit(7, 2.0)], Some(Fault::Miss)),
            (&[due[0], due[1], due[2], hit(7, 3.0)], Some(Fault::False)),
            (&[due[0], due[2], due[1]], Some(Fault::Order)),
            (&[due[0], due[0], due[1], due[2]], Some(Fault::Twice)),
            (&[due[0], hit(1, 2.0f32.next_up()), due[2]], Some(Fault::T)),
            (&[due[0], due[1], off], Some(Fault::Weights)),
        ];
        for (found, expected) in cases {
            assert_eq!(fault_of_list(found, &due), expected, "{found:?}");
        }
        assert_eq!((fault_of_list(&[], &[]), fault_of_list(&due, &[])), (None, Some(Fault::False)));
    }

    /// The filters in doubles lose nothing, and a walk is what its words say: here the exact tracer is asked again.
    #[test]
    fn lists_have_every_triangle_and_walks_ask_again() {
        let (mut hits, mut stepped_over) = (0, 0);
        for kind in Question::Lists.kinds().filter(|kind| kind.name.starts_with("stack-") || kind.name == "layers") {
            let case = kind.case(SEED, 40);
            let (tracer, lists) = (ExactTracer::new(&case.mesh), Lists::new(&case));
            for (i, ray) in case.rays.iter().enumerate() {
                let line = tracer.line(ray.origin.as_dvec3(), ray.direction.as_dvec3()).unwrap();
                let mut interval = Interval { near: ray.t_min, far: ray.t_max, is_open: false };
                let every = (0..case.mesh.triangles.len() as u32).filter_map(|i| tracer.crossing(&line, i));
                let mut every: Vec<_> = every.filter(|crossing| interval.contains(&crossing.t)).collect();
                every.sort_by(|a, b| a.t.cmp(&b.t).then(a.primitive.cmp(&b.primitive)));
                let list = lists.list(i);
                assert!(
                    list.iter().map(|hit| hit.primitive).eq(every.iter().map(|hit| hit.primitive)),
                    "{}",
                    kind.name
                );
                let walk = lists.walk(i);
                for due in &walk {
                    let closest = tracer.closest(&line, interval, &[], |_| true).unwrap();
                    assert_eq!(due.primitive, closest.crossing.primitive, "{} ray {i}", kind.name);
                    interval.near = due.t.next_up();
                }
                assert!(tracer.closest(&line, interval, &[], |_| true).is_none(), "{} ray {i}", kind.name);
                hits += list.len();
                stepped_over += list.len() - walk.len();
            }
        }
        assert!(hits > 4000 && stepped_over > 1000, "{hits} {stepped_over}");
    }

    /// Whatever a line meets of closed meshes, it goes out as often as in.
    #[test]
    fn closed_meshes_are_crossed_evenly() {
        for name in ["edges", "silhouettes", "fans", "duplicates", "stack-copies", "stack-shells"] {
            let mut case = Kind::find(name).unwrap().case(SEED, 40);
            case.rays.iter_mut().for_each(|ray| *ray = ray.within(f32::NEG_INFINITY, f32::INFINITY));
            let lists = Lists::new(&case);
            let crossed = (0..case.rays.len()).filter(|&i| lists.crossings(i) > 0).count();
            assert!((0..case.rays.len()).all(|i| lists.crossings(i).is_multiple_of(2)), "{name}");
            assert!(crossed > 20, "{name}: {crossed}");
        }
    }
}
