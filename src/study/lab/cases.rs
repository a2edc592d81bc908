//! Judges answers to cases whose exact answers are known.

use super::{Lab, Variant, errors};
use crate::error::Result;
use crate::options::Intersector;
use crate::stress::{Answers, Case, Found};
use crate::study::table::{Row, row};
use serde_json::{Value, json};

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
}
