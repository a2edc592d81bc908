//! Judges answers that are known exactly, and paths that must go on.

use super::{Lab, Variant, errors};
use crate::error::Result;
use crate::options::Intersector;
use crate::pack::SceneBuffers;
use crate::scene::Samples;
use crate::session::{Picture, open_tracer, render};
use crate::stats::RayCounts;
use crate::stress::{Answers, Case, Found};
use crate::study::scenes::mirror_room;
use crate::study::table::{Row, row};
use serde_json::{Value, json};
use std::sync::Arc;

impl Lab<'_> {
    /// Traces the case that `make` makes with all `variants`, and tells of each how many answers are wrong: one row each, with `value` in
    /// column `column`, which together with `rays`, the number of rays, names the case. Methods that promise exact hits are judged
    /// strictly.
    ///
    /// # Errors
    /// As [`Found::new`].
    pub fn judge_case(
        &mut self,
        variants: &[Variant],
        column: &str,
        value: &Value,
        rays: usize,
        make: impl Fn() -> Case,
    ) -> Result<Vec<Row>> {
        let settings: Vec<_> = variants.iter().map(|v| json!([v.label, v.options])).collect();
        let key = json!(["judged", column, value, rays, settings]);
        if let Some(rows) = self.journal.find(&key) {
            return Ok(rows);
        }
        (self.progress)(&format!("{column} {value}"));
        let case = make();
        let answers = Answers::new(&case);
        let mut rows = Vec::new();
        for Variant { label, options, .. } in variants {
            let found = Found::new(&case, options, self.device, self.cache)?;
            let strictly = options.intersector == Intersector::Exact && options.traversal.is_exact();
            let mut out = row([("method", json!(label))]);
            out.insert(column.to_owned(), value.clone());
            out.extend(errors(found.faults(&answers, strictly).len(), case.rays.len()));
            rows.push(out);
        }
        self.journal.keep(&key, &rows)?;
        Ok(rows)
    }

    /// Renders a closed room of mirrors from inside with all `variants` and chains of `depth` rays, and tells of each how many chains
    /// escaped: one row each.
    ///
    /// # Errors
    /// As [`SceneBuffers::new`], [`open_tracer`](crate::session::open_tracer) and [`render`].
    pub fn lost_paths(&mut self, variants: &[Variant], depth: u32) -> Result<Vec<Row>> {
        let settings: Vec<_> = variants.iter().map(|v| json!([v.label, v.options])).collect();
        let key = json!(["lost paths", depth, self.side(), settings]);
        if let Some(rows) = self.journal.find(&key) {
            return Ok(rows);
        }
        (self.progress)(&format!("chains of {depth} rays"));
        let scene = mirror_room()?;
        let side = self.side();
        let mut rows = Vec::new();
        for Variant { label, options, .. } in variants {
            let buffers = Arc::new(SceneBuffers::new(&scene, options)?);
            let mut tracer = open_tracer(self.device, &buffers, options, depth, self.cache)?;
            let picture = Picture {
                camera: scene.camera.expect("the room has a camera"),
                size: (side, side),
                samples: Samples::PerPixel(1),
                depth,
                kill_weight: Some(0.0),
            };
            let result = render(tracer.as_mut(), &buffers, &picture, &|_| ())?;
            let RayCounts { camera, reflected, .. } = RayCounts::from_counters(&result.counts);
            let lost = camera.cast + reflected.cast - camera.hit - reflected.hit;
            let mut out = row([("method", json!(label)), ("depth", json!(depth))]);
            out.extend(errors(lost as usize, camera.cast as usize));
            rows.push(out);
        }
        self.journal.keep(&key, &rows)?;
        Ok(rows)
    }
}
