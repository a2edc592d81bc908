//! The rows of other tracers, as those of the program's own methods are.

use super::results::{Peer, Results};
use super::{Checksum, Source, sets};
use crate::stress::{Answers, Case, Fault, Found};
use crate::study::lab::{errors, with_rate};
use crate::study::studies::{stress_kinds, stress_rays_a_kind};
use crate::study::table::{Row, row};
use crate::study::{Lab, Subject};
use raybrook::{Error, Result};
use serde_json::json;

/// Rows of other tracers.
#[derive(Debug, Default)]
pub struct Judged {
    /// Of rays through the scenes.
    pub rays: Vec<Row>,
    /// Of stress rays.
    pub modes: Vec<Row>,
    /// The tracers.
    pub peers: Vec<Row>,
}

/// Judges all answers of the lab's other tracers to the rays through `subjects` and to stress rays.
///
/// # Errors
/// [`Error::Input`] when they are answers to other rays, or not whole; it names the file and the set.
pub fn judge(lab: &Lab, subjects: &[Subject]) -> Result<Judged> {
    let mut judged = Judged::default();
    let peers = &lab.peers;
    if peers.is_empty() {
        return Ok(judged);
    }
    let sets = sets(subjects, &stress_kinds(lab), stress_rays_a_kind(lab));
    let names: Vec<_> = sets.iter().map(|set| set.name.as_str()).collect();
    for (i, peer) in peers.iter().enumerate() {
        peer.check_rays(lab.seed, lab.quick, lab.side(), &names)?;
        let label = peer.label();
        if let Some(same) = peers[..i].iter().find(|other| other.label() == label) {
            let message = format!("'{label}' is in '{}', too; give one of them another mode", same.path().display());
            return Err(Error::input(peer.path(), None, message));
        }
        judged.peers.push(row([
            ("method", json!(label)),
            ("machine", json!(peer.machine())),
            ("threads", json!(peer.threads())),
            ("clock", json!(peer.clock().name())),
        ]));
    }
    let mut sum = Checksum::default();
    for set in &sets {
        (lab.progress)(&format!("other tracers: {}", set.name));
        let case = set.case(lab.seed)?;
        let checksum = Checksum::of(&case);
        sum.add(&set.name, &checksum);
        let is_timed = matches!(set.source, Source::Scene(..));
        let results = peers.iter().map(|peer| Ok((peer, peer.results(&set.name, &case, &checksum, is_timed)?)));
        let results = results.collect::<Result<Vec<_>>>()?;
        match set.source {
            Source::Scene(subject, kind) => {
                judged.rays.extend(results.into_iter().map(|(peer, results)| of_scene(subject, kind, peer, &results)));
            }
            Source::Stress(kind, _) => {
                let answers = Answers::new(&case);
                let rows =
                    results.into_iter().map(|(peer, results)| of_stress(&case, &answers, kind.name, peer, results));
                judged.modes.extend(rows);
            }
        }
    }
    let checksum = sum.finish();
    peers.iter().try_for_each(|peer| peer.check_whole(&checksum))?;
    Ok(judged)
}

fn of_scene(subject: &Subject, kind: usize, peer: &Peer, results: &Results) -> Row {
    let batch = &subject.batches[kind];
    let (wrong, largest_t_ulp) = subject.judge(kind, &results.hits);
    let mut out = row([
        ("scene", json!(subject.name)),
        ("triangles", json!(subject.triangle_count)),
        ("method", json!(peer.label())),
        ("rays_of", json!(batch.name)),
        ("call", json!(results.call)),
    ]);
    out.extend(errors(wrong, batch.rays.len()));
    if !batch.any_hit {
        out.insert("largest_t_ulp".into(), json!(largest_t_ulp));
    }
    let mut out = with_rate(out, batch.rays.len(), results.seconds);
    // Of another clock than that of a device's kernels.
    if let Some(seconds) = out.shift_remove("kernel_s") {
        out.insert("pass_s".into(), seconds);
    }
    out
}

fn of_stress(case: &Case, answers: &Answers, mode: &str, peer: &Peer, results: Results) -> Row {
    let found = Found { hits: results.hits, next_hits: results.next_hits };
    // Within float32's rounding errors, as other methods that do not promise exact hits.
    let faults = found.faults(answers, false);
    let mut out = row([("method", json!(peer.label())), ("mode", json!(mode)), ("call", json!(results.call))]);
    out.extend(errors(faults.len(), case.rays.len()));
    let count = |sort: Fault| faults.iter().filter(|(_, fault)| *fault == sort).count();
    let counted = Fault::OF_CLOSEST.into_iter().map(|sort| (sort.name(), count(sort))).filter(|(_, count)| *count > 0);
    let sorts: Vec<_> = counted.map(|(name, count)| format!("{name} {count}")).collect();
    if !sorts.is_empty() {
        out.insert("faults".to_owned(), json!(sorts.join(", ")));
    }
    out
}
