//! Which secondary rays matter: chains of limited depth, rays killed by their weight, rays killed at random.

use super::super::lab::PictureVariant;
use super::super::outcome::Outcome;
use super::super::table::{Row, name, number};
use super::super::{Chart, ChartKind, Findings, Lab, Measured, Study, Table, scenes};
use super::pareto::fast_options;
use super::{PICTURE, Verdict, by_scene, ratio_of, scenes_of};
use crate::study::lookup::geometric_mean;
use raybrook::Result;
use raybrook::low_level::options::{PictureOptions, TraceOptions};
use raybrook::low_level::scene::Scene;

pub const STUDY: Study = Study {
    name: "killing",
    title: "Which secondary rays matter",
    claim: "Thesis, section 2.1.2: the number of rays must be limited, by anything from killing rays at random to a \
            greatest number of reflections. The claim tested: with an error that is no larger than that of chains of \
            at most 2, 3, ... rays, killing by weight or at random takes fewer rays (geometric mean over those depths, \
            of as many samples).",
    own_shapes: None,
    source: include_str!("killing.rs"),
    measure,
    judge,
};

/// Chains of all pictures but those that a depth limits, and of the converged one.
const MOST_DEPTH: u32 = 8;

/// What limits the rays of a picture, as its column says.
const ALL: &str = "nothing";
const BY_DEPTH: &str = "depth";
const BY_WEIGHT: &str = "weight";
const AT_RANDOM: &str = "roulette";

/// The weight of the roulette of which the verdict tells the noise.
const TOLD_WEIGHT: f64 = 0.1;

/// The user's scenes, or some with mirrors and glass.
fn killing_scenes(lab: &Lab) -> Result<Vec<(String, Scene)>> {
    if !lab.scenes.is_empty() {
        return Ok(lab.scenes.to_vec());
    }
    let detail = if lab.quick { 16 } else { 96 };
    Ok(vec![
        ("still life".to_owned(), scenes::still_life(detail, false)?),
        ("still life with glass".to_owned(), scenes::glass_still_life(detail)?),
        ("mirrors and glass".to_owned(), scenes::mirrors_and_glass(detail)?),
    ])
}

fn measure(lab: &mut Lab) -> Result<Vec<Table>> {
    let options = fast_options(lab);
    let samples: &[u32] = if lab.quick { &[1, 4] } else { &[1, 4, 16] };
    let variants: Vec<_> = samples.iter().flat_map(|&samples| variants(options, samples, lab.quick)).collect();
    let converged = (if lab.quick { 64 } else { 256 }, MOST_DEPTH);
    let mut rows = Vec::new();
    for (scene_name, scene) in killing_scenes(lab)? {
        rows.extend(lab.pictures(&scene_name, &scene, &variants, Some(converged))?);
    }
    Ok(vec![Table::new("pictures", "Pictures by what limits their rays", rows)])
}

/// The pictures of so many samples. But for what limits them, they have every ray.
fn variants(options: TraceOptions, samples: u32, is_quick: bool) -> Vec<PictureVariant> {
    let (depths, weights, roulettes): (&[u32], &[f64], &[f64]) = match (is_quick, samples) {
        (true, _) => (&[2, 4], &[0.01, 0.1], &[TOLD_WEIGHT]),
        // Between the fewest and the most samples only the noise is told.
        (false, 4) => (&[], &[], &[0.03, TOLD_WEIGHT, 0.3, 1.0]),
        (false, _) => (&[1, 2, 3, 4, 5, 6, 7], &[0.003, 0.01, 0.03, 0.1, 0.3], &[0.03, TOLD_WEIGHT, 0.3, 1.0]),
    };
    let many = format!("{samples} sample{}", if samples == 1 { "" } else { "s" });
    let one = |label: &str, options, depth, limited_by: &str| {
        let label = if label.is_empty() { many.clone() } else { format!("{many}, {label}") };
        PictureVariant::new(label, options, samples, depth).without_killing().with("limited_by", limited_by)
    };
    let mut all = vec![one("", options, MOST_DEPTH, ALL)];
    all.extend(depths.iter().map(|&depth| one(&format!("depth {depth}"), options, depth, BY_DEPTH)));
    all.extend(weights.iter().map(|&weight| {
        let variant = one(&format!("weight {weight}"), options, MOST_DEPTH, BY_WEIGHT).with("weight", weight);
        PictureVariant { kill_weight: Some(weight as f32), ..variant }
    }));
    all.extend(roulettes.iter().map(|&weight| {
        let picture = PictureOptions { roulette: Some(weight as f32), ..options.picture };
        let options = TraceOptions { picture, ..options };
        one(&format!("roulette {weight}"), options, MOST_DEPTH, AT_RANDOM).with("weight", weight)
    }));
    all
}

fn judge(found: &Measured) -> Result<Findings> {
    let pictures = found.table("pictures", &PICTURE)?;
    let mut verdict = Verdict::default();
    let mut notes = Vec::new();
    for scene in scenes_of(&pictures.rows) {
        let mut of_scene = Vec::new();
        for samples in samples_of(&pictures, &scene) {
            of_scene.extend(Limits::of(&pictures, &scene, samples)?);
        }
        match of_scene.last().map(|most| (most.samples, most.ratios())) {
            None => verdict.not_measured(&scene),
            Some((_, None)) => verdict.add(format!("{scene}: no chain of more than 2 rays changes it")),
            Some((samples, Some([by_weight, at_random]))) => verdict.say(
                Outcome::of(by_weight.min(at_random) < 1.0),
                format!(
                    "{scene}: with the errors of limited depths at {samples} samples killing by weight takes \
                     {by_weight:.2} of their rays, at random {at_random:.2}"
                ),
            ),
        }
        // In a hurry there are too few weights to compare.
        notes.extend(where_it_pays(&scene, &of_scene).filter(|_| !found.header.quick));
        notes.extend(noise(&pictures, &scene)?);
    }
    notes.push(
        "Every picture has the samples of those that it is compared with, so that a difference of errors is the \
         limit's. Where no picture of a kind is as good as a limited depth, the one of all rays counts for it."
            .to_owned(),
    );
    // Rays and errors are counted, not timed: no spread is in the way. In a hurry the pictures are too small to tell.
    let outcome = if found.header.quick { Outcome::Undecided } else { verdict.all() };
    let charts = by_scene(
        ChartKind::Front,
        &pictures,
        "pictures",
        "pictures a second against error",
        ["error", "frames_per_s"],
        |chart: Chart| chart.log(true, true).caption("Exact hits; by the wall clock. Left and high is better."),
    );
    Ok(Findings { outcome, notes, ..verdict.findings(vec![pictures], charts) })
}

/// The numbers of samples of a scene's pictures, the fewest first.
fn samples_of(pictures: &Table, scene: &str) -> Vec<u64> {
    let of_scene = pictures.rows.iter().filter(|row| name(row, "scene") == scene);
    let mut all: Vec<u64> = of_scene.filter_map(|row| row.get("samples")?.as_u64()).collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// The pictures of a scene with so many samples.
struct Limits<'a> {
    samples: u64,
    all: &'a Row,
    by_depth: Vec<&'a Row>,
    by_weight: Vec<&'a Row>,
    at_random: Vec<&'a Row>,
}

impl<'a> Limits<'a> {
    /// `None` where a kind of limit is missing, or the error of a picture.
    fn of(pictures: &'a Table, scene: &str, samples: u64) -> Result<Option<Self>> {
        let many = samples.to_string();
        let rows = || pictures.rows.iter().filter(|row| name(row, "scene") == scene && name(row, "samples") == many);
        let is_measured = rows().all(|row| number(row, "error").is_some() && number(row, "rays").is_some());
        let key = [("scene", scene), ("samples", &many), ("limited_by", ALL)];
        let all = pictures.one(&key)?.filter(|_| is_measured);
        let by = |limit: &str| -> Vec<&Row> { rows().filter(|row| name(row, "limited_by") == limit).collect() };
        let [by_depth, by_weight, at_random] = [BY_DEPTH, BY_WEIGHT, AT_RANDOM].map(by);
        let is_whole = ![&by_depth, &by_weight, &at_random].iter().any(|rows| rows.is_empty());
        Ok(all.filter(|_| is_whole).map(|all| Limits { samples, all, by_depth, by_weight, at_random }))
    }

    /// What killing by weight and at random takes of the rays of limited depths, the errors being no larger: geometric
    /// means over the depths from 2 on whose errors are larger than that of all rays; `None` without any.
    fn ratios(&self) -> Option<[f64; 2]> {
        let value = |row: &Row, column: &str| number(row, column).unwrap_or(f64::INFINITY);
        let limited = self.by_depth.iter().filter(|row| value(row, "depth") >= 2.0);
        let limited: Vec<_> = limited.filter(|row| value(row, "error") > value(self.all, "error")).collect();
        let of = |killed: &[&Row]| {
            geometric_mean(limited.iter().map(|depth| {
                let as_good = killed.iter().filter(|row| value(row, "error") <= value(depth, "error"));
                as_good.chain([&self.all]).filter_map(|row| ratio_of(row, depth, "rays")).min_by(f64::total_cmp)
            }))
        };
        Some([of(&self.by_weight)?, of(&self.at_random)?])
    }
}

/// By samples a pixel, which kind of killing takes fewer rays.
fn where_it_pays(scene: &str, of_scene: &[Limits]) -> Option<String> {
    let part = |limits: &Limits| {
        let [by_weight, at_random] = limits.ratios()?;
        let loses = if at_random > by_weight { ", which does not pay" } else { "" };
        Some(format!("{}: by weight {by_weight:.2}, at random {at_random:.2}{loses}", limits.samples))
    };
    let parts: Vec<_> = of_scene.iter().filter_map(part).collect();
    let text = format!("{scene}, part of the rays of limited depths, by samples a pixel: {}.", parts.join("; "));
    (!parts.is_empty()).then_some(text)
}

/// What roulette costs in noise: its rays and its error by those of all rays, by samples a pixel.
fn noise(pictures: &Table, scene: &str) -> Result<Option<String>> {
    let mut parts = Vec::new();
    let told = TOLD_WEIGHT.to_string();
    for all in pictures.rows.iter().filter(|row| name(row, "scene") == scene && name(row, "limited_by") == ALL) {
        let samples = name(all, "samples");
        let key = [("scene", scene), ("samples", &samples[..]), ("limited_by", AT_RANDOM), ("weight", told.as_str())];
        let Some(random) = pictures.one(&key)? else { continue };
        let (Some(rays), Some(error)) = (ratio_of(random, all, "rays"), ratio_of(random, all, "error")) else {
            continue;
        };
        parts.push(format!("{samples}: {rays:.2} of the rays, {error:.2} times the error"));
    }
    let text = format!("{scene}, roulette {told} against all rays, by samples a pixel: {}.", parts.join("; "));
    Ok((!parts.is_empty()).then_some(text))
}

#[cfg(test)]
mod tests {
    use super::super::super::table::row;
    use super::super::rows_of::{header, judge};
    use super::*;
    use serde_json::json;

    /// A picture: what limits it and to what, rays and error.
    type Made = (&'static str, f64, u32, f64);

    fn pictures(samples: u32, made: &[Made]) -> Vec<Row> {
        let picture = |&(limited_by, value, rays, error): &Made| {
            let mut out = row([
                ("scene", json!("s")),
                ("method", json!(format!("{samples}, {limited_by} {value}"))),
                ("depth", json!(if limited_by == BY_DEPTH { value } else { f64::from(MOST_DEPTH) })),
                ("samples", json!(samples)),
                ("limited_by", json!(limited_by)),
                ("rays", json!(rays)),
                ("error", json!(error)),
            ]);
            if [BY_WEIGHT, AT_RANDOM].contains(&limited_by) {
                out.insert("weight".into(), json!(value));
            }
            out
        };
        made.iter().map(picture).collect()
    }

    fn found(rows: Vec<Row>, is_quick: bool) -> Findings {
        judge(&STUDY, vec![Table::new("pictures", "", rows)], &header(is_quick)).unwrap()
    }

    /// Depths 2 and 3 have larger errors than all rays, 4 has the same, and 1 casts no secondary ray.
    const DEPTHS: [Made; 5] = [
        (ALL, 0.0, 1000, 1.0),
        (BY_DEPTH, 1.0, 100, 9.0),
        (BY_DEPTH, 2.0, 400, 3.0),
        (BY_DEPTH, 3.0, 800, 2.0),
        (BY_DEPTH, 4.0, 900, 1.0),
    ];

    fn with(weight: [Made; 2], random: Made) -> Vec<Row> {
        pictures(16, &[&DEPTHS[..], &weight, &[random]].concat())
    }

    #[test]
    fn killing_must_take_fewer_rays_for_errors_that_are_no_larger() {
        // As good as depth 2 with half of its rays and as good as depth 3 with half of its rays; at random in 0.9 of
        // depth 3's, and for depth 2 the same.
        let good = with([(BY_WEIGHT, 0.5, 200, 3.0), (BY_WEIGHT, 0.1, 400, 1.5)], (AT_RANDOM, 0.1, 720, 2.0));
        let holds = found(good.clone(), false);
        assert_eq!(holds.outcome, Outcome::Holds);
        // sqrt(0.5 * 0.5); sqrt(720 / 400 * 720 / 800).
        assert!(holds.verdict.contains("by weight takes 0.50 of their rays, at random 1.27"), "{}", holds.verdict);
        assert_eq!(found(good, true).outcome, Outcome::Undecided, "in a hurry nothing is claimed");

        // More rays than the depths; at random with an error that is too large for either: all rays count.
        let bad = with([(BY_WEIGHT, 0.5, 900, 3.0), (BY_WEIGHT, 0.1, 950, 1.5)], (AT_RANDOM, 0.1, 10, 3.1));
        let fails = found(bad, false);
        assert_eq!(fails.outcome, Outcome::Fails);
        // sqrt(900 / 400 * 950 / 800); sqrt(1000 / 400 * 1000 / 800).
        assert!(fails.verdict.contains("by weight takes 1.63 of their rays, at random 1.77"), "{}", fails.verdict);

        // At random alone.
        let random = with([(BY_WEIGHT, 0.5, 900, 3.0), (BY_WEIGHT, 0.1, 950, 1.5)], (AT_RANDOM, 0.1, 300, 1.9));
        assert_eq!(found(random, false).outcome, Outcome::Holds);
    }

    #[test]
    fn a_scene_that_depth_does_not_change_tells_nothing() {
        let flat: Vec<Made> = DEPTHS.iter().map(|&(limit, value, rays, _)| (limit, value, rays, 1.0)).collect();
        let rows = pictures(16, &[&flat[..], &[(BY_WEIGHT, 0.1, 10, 1.0), (AT_RANDOM, 0.1, 10, 1.0)]].concat());
        let found = found(rows, false);
        assert!(
            found.outcome == Outcome::Undecided && found.verdict.contains("no chain of more than 2 rays"),
            "{}",
            found.verdict
        );
    }

    #[test]
    fn what_is_missing_is_not_measured() {
        let whole = with([(BY_WEIGHT, 0.5, 200, 3.0), (BY_WEIGHT, 0.1, 400, 1.5)], (AT_RANDOM, 0.1, 720, 2.0));
        let lacking = |limit: &str| whole.iter().filter(|row| name(row, "limited_by") != limit).cloned().collect();
        for limit in [ALL, BY_DEPTH, BY_WEIGHT, AT_RANDOM] {
            let found = found(lacking(limit), false);
            assert_eq!((found.outcome, &found.verdict[..]), (Outcome::Undecided, "s: not measured."), "{limit}");
        }
        let mut no_error = whole.clone();
        no_error[3].shift_remove("error");
        assert_eq!(found(no_error, false).outcome, Outcome::Undecided);
    }

    #[test]
    fn where_random_killing_does_not_pay_is_told() {
        // Of few samples it takes more rays than killing by weight, of many fewer.
        let kinds =
            |random: u32| [(BY_WEIGHT, 0.5, 200, 3.0), (BY_WEIGHT, 0.1, 400, 1.5), (AT_RANDOM, 0.1, random, 1.0)];
        let [few, many] = [(1, 800), (16, 100)].map(|(n, rays)| pictures(n, &[&DEPTHS[..], &kinds(rays)].concat()));
        let found = found([many, few].concat(), false);
        assert_eq!(
            found.notes[0],
            "s, part of the rays of limited depths, by samples a pixel: 1: by weight 0.50, at random 1.41, which does \
             not pay; 16: by weight 0.50, at random 0.18."
        );
        assert!(found.verdict.contains("at 16 samples killing by weight takes 0.50 of their rays, at random 0.18"));
    }

    #[test]
    fn noise_is_told_for_each_number_of_samples() {
        let few = pictures(1, &[(ALL, 0.0, 100, 4.0), (AT_RANDOM, 0.1, 70, 6.0), (AT_RANDOM, 1.0, 60, 8.0)]);
        let many = with([(BY_WEIGHT, 0.5, 200, 3.0), (BY_WEIGHT, 0.1, 400, 1.5)], (AT_RANDOM, 0.1, 700, 1.1));
        let notes = found([few, many].concat(), false).notes;
        let expected = "s, roulette 0.1 against all rays, by samples a pixel: 1: 0.70 of the rays, 1.50 times the \
                        error; 16: 0.70 of the rays, 1.10 times the error.";
        assert_eq!(notes[1], expected);
    }
}
