//! What is asked of the rays, and the exact answers and a tracer's to each question.

use super::case::Case;
use super::judge::{Answers, Fault};
use super::kinds::Kind;
use super::lists::{Lists, fault_of_list};
use super::run::{Found, open};
use glam::Vec3;
use raybrook::Result;
use raybrook::low_level::crossings::count_crossings;
use raybrook::low_level::device::{Cache, DeviceHandle};
use raybrook::low_level::options::{Intersector, TraceOptions};
use raybrook::low_level::parallel;
use raybrook::low_level::shared::Hit;
use raybrook::low_level::tracer::{AllHitsJob, is_hit};

/// What is asked of each ray.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Question {
    /// The closest hit, or any, and that of the secondary ray.
    #[default]
    Closest,
    /// All hits, and how often a surface is crossed.
    Lists,
    /// The closest hit, again and again from the float behind the last one.
    Walks,
}

impl Question {
    /// All of them.
    pub const ALL: [Question; 3] = [Question::Closest, Question::Lists, Question::Walks];

    /// As the user types it.
    pub fn name(self) -> &'static str {
        match self {
            Question::Closest => "closest",
            Question::Lists => "lists",
            Question::Walks => "walks",
        }
    }

    /// In one line.
    pub fn about(self) -> &'static str {
        match self {
            Question::Closest => "the closest hit, and that of a secondary ray",
            Question::Lists => "all hits in their order, and with exact hits how often surfaces are crossed",
            Question::Walks => "the closest hit, again and again from the float behind the last one",
        }
    }

    /// What may be wrong, in the order in which it is reported.
    pub fn faults(self) -> &'static [Fault] {
        match self {
            Question::Closest => &Fault::OF_CLOSEST,
            Question::Lists => &Fault::OF_LISTS,
            Question::Walks => &Fault::OF_WALKS,
        }
    }

    /// The exact hits of a ray, of those of [`Question::Walks`] where that is asked.
    pub fn hits(self, lists: &Lists, ray: usize) -> Vec<Hit> {
        if self == Question::Walks { lists.walk(ray) } else { lists.list(ray) }
    }

    /// The kinds of rays that are asked unless told otherwise.
    pub fn kinds(self) -> impl Iterator<Item = &'static Kind> {
        let stacks = (self != Question::Closest).then(Kind::stacks);
        Kind::all().chain(stacks.into_iter().flatten())
    }
}

/// The exact answers of a case to a question.
pub enum Exact<'a> {
    /// To [`Question::Closest`].
    Closest(Answers<'a>),
    /// To [`Question::Lists`] and [`Question::Walks`].
    Lists(Lists, Question),
}

impl<'a> Exact<'a> {
    /// Answers the question for all rays of a case.
    pub fn new(question: Question, case: &'a Case) -> Exact<'a> {
        match question {
            Question::Closest => Exact::Closest(Answers::new(case)),
            Question::Lists | Question::Walks => Exact::Lists(Lists::new(case), question),
        }
    }

    /// How many hits the lists or walks of all rays have.
    pub fn hit_count(&self, case: &Case) -> Option<usize> {
        match self {
            Exact::Closest(_) => None,
            Exact::Lists(lists, question) => Some((0..case.rays.len()).map(|i| question.hits(lists, i).len()).sum()),
        }
    }

    /// Asks a method the same question.
    ///
    /// # Errors
    /// As [`Found::new`].
    pub fn ask(
        &self,
        case: &Case,
        options: &TraceOptions,
        device: Option<&DeviceHandle>,
        cache: Option<&Cache>,
    ) -> Result<Given> {
        Ok(match self {
            Exact::Closest(_) => Given::Hits(Found::new(case, options, device, cache)?),
            Exact::Lists(_, Question::Walks) => Given::Lists(FoundLists::of_walks(case, options, device, cache)?),
            Exact::Lists(..) => Given::Lists(FoundLists::new(case, options, device, cache)?),
        })
    }

    /// The rays with wrong answers, by number. Lists and walks are always judged strictly.
    ///
    /// # Panics
    /// When `given` answers another question.
    pub fn faults(&self, given: &Given, strictly: bool) -> Vec<(usize, Fault)> {
        match (self, given) {
            (Exact::Closest(answers), Given::Hits(found)) => found.faults(answers, strictly),
            (Exact::Lists(lists, question), Given::Lists(found)) => found.faults(lists, *question),
            _ => panic!("another question was asked"),
        }
    }
}

/// What a tracer answered.
#[derive(Debug, Clone)]
pub enum Given {
    /// To [`Question::Closest`].
    Hits(Found),
    /// To the others.
    Lists(FoundLists),
}

/// Lists or walks as a tracer found them, in world units.
#[derive(Debug, Clone)]
pub struct FoundLists {
    /// The hits of each ray.
    pub hits: Vec<Vec<Hit>>,
    /// How often each ray crosses a surface; only of exact hits, and not of walks.
    pub crossings: Option<Vec<u32>>,
}

impl FoundLists {
    /// Lists all hits of the rays of `case`; devices as for [`Found::new`].
    ///
    /// # Errors
    /// As there.
    pub fn new(
        case: &Case,
        options: &TraceOptions,
        device: Option<&DeviceHandle>,
        cache: Option<&Cache>,
    ) -> Result<FoundLists> {
        let (buffers, mut tracer) = open(case, options, device, cache)?;
        let batch = buffers.batch(case.rays.len(), |i| case.ray(i), None);
        let all = tracer.trace_all(&AllHitsJob::of(&batch.job(false, 1)), &|_| ())?;
        let of_ray = |i: usize| -> (Vec3, Vec3) { (case.rays[i].origin, case.rays[i].direction) };
        let is_exact = options.intersector == Intersector::Exact;
        let crossings = is_exact.then(|| count_crossings(&buffers, &all, of_ray));
        let hits = (0..case.rays.len()).map(|i| all.of_ray(i).to_vec()).collect();
        Ok(FoundLists { hits, crossings })
    }

    /// Walks along the rays of `case`; devices as for [`Found::new`].
    ///
    /// # Errors
    /// As there.
    pub fn of_walks(
        case: &Case,
        options: &TraceOptions,
        device: Option<&DeviceHandle>,
        cache: Option<&Cache>,
    ) -> Result<FoundLists> {
        let (buffers, mut tracer) = open(case, options, device, cache)?;
        let mut hits = vec![Vec::new(); case.rays.len()];
        // Those that walk on, and from which t.
        let mut walking: Vec<(usize, f32)> = case.rays.iter().map(|ray| ray.t_min).enumerate().collect();
        // A walk that is longer has met a triangle twice.
        for _ in 0..=case.mesh.triangles.len() {
            let ray = |k: usize| {
                let (i, t_min) = walking[k];
                let (origin, direction, _, t_max) = case.ray(i);
                (origin, direction, t_min, t_max)
            };
            let batch = buffers.batch(walking.len(), ray, None);
            let closest = tracer.trace(&batch.job(false, 1), &|_| ())?.hits;
            let met = walking.iter().zip(closest).filter(|(_, hit)| is_hit(hit));
            let goes_on = |(&(i, _), hit): (&(usize, f32), Hit)| {
                hits[i].push(hit);
                (i, hit.t.next_up())
            };
            walking = met.map(goes_on).collect();
            if walking.is_empty() {
                break;
            }
        }
        Ok(FoundLists { hits, crossings: None })
    }

    /// The rays with wrong answers, by number.
    fn faults(&self, lists: &Lists, question: Question) -> Vec<(usize, Fault)> {
        let fault = |i: usize| {
            let crosses_wrongly = || self.crossings.as_ref().is_some_and(|found| found[i] != lists.crossings(i));
            let of_list = fault_of_list(&self.hits[i], &question.hits(lists, i));
            of_list.or_else(|| crosses_wrongly().then_some(Fault::Crossings))
        };
        parallel::flat_map_numbers(self.hits.len(), |i| Some((i, fault(i)?)))
    }
}
