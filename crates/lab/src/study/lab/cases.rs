//! Judges answers to cases whose exact answers are known.

use super::{Lab, Variant, differences, errors, promise};
use crate::stress::{Answers, Case, Fault, Found};
use crate::study::table::{Row, name, row};
use raybrook::Result;
use serde_json::json;

impl Lab<'_> {
    /// Traces the case that `make` makes with all `variants`, and tells of each how many answers are wrong: one row
    /// each, with the columns of `case`, which together with `rays`, the number of rays, name the case. Methods that
    /// promise exact hits are judged strictly.
    ///
    /// # Errors
    /// As [`Found::new`].
    pub fn judge_case(
        &mut self,
        variants: &[Variant],
        case: &Row,
        rays: usize,
        make: impl Fn() -> Case,
    ) -> Result<Vec<Row>> {
        let settings: Vec<_> = variants.iter().map(|v| json!([v.label, v.options])).collect();
        let key = json!(["judged", case, rays, settings]);
        if let Some(rows) = self.journal.find(&key) {
            return Ok(rows);
        }
        let said: Vec<_> = case.keys().map(|column| format!("{column} {}", name(case, column))).collect();
        (self.progress)(&said.join(", "));
        let made = make();
        let answers = Answers::new(&made);
        let mut rows = Vec::new();
        for Variant { label, options, .. } in variants {
            let found = Found::new(&made, options, self.device, self.cache)?;
            let promise = promise(options);
            let strictly = !promise.is_empty();
            let mut out = row([("method", json!(label))]);
            out.extend(case.clone());
            out.extend(promise);
            let exactly = found.faults(&answers, true);
            let differing = exactly.iter().filter(|(_, fault)| !matches!(fault, Fault::T | Fault::Weights)).count();
            let wrong = if strictly { exactly.len() } else { found.faults(&answers, false).len() };
            out.extend(errors(wrong, made.rays.len()));
            out.extend(differences(differing, made.rays.len()));
            rows.push(out);
        }
        self.journal.keep(&key, &rows)?;
        Ok(rows)
    }
}
