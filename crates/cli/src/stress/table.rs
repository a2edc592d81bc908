//! What `stress` prints: counts in columns.

use super::{Row, Sheet};
use raybrook_lab::stress::{Method, Question};

/// Counts in columns: the sorts of one method's faults, or wrong answers by method.
pub struct Table<'a> {
    pub methods: &'a [Method],
    pub question: Question,
    pub is_wide: bool,
}

impl Table<'_> {
    const SORT_WIDTH: usize = 7;

    fn method_width(method: &Method) -> usize {
        method.name.chars().count().max(Self::SORT_WIDTH)
    }

    pub fn say_head(&self) {
        let columns: String = if self.is_wide {
            self.methods.iter().map(|m| format!(" {:>1$}", m.name, Self::method_width(m))).collect()
        } else {
            self.question.faults().iter().map(|sort| format!(" {:>1$}", sort.name(), Self::SORT_WIDTH)).collect()
        };
        let wrong = if self.is_wide { "" } else { "   wrong" };
        let hits = if self.question == Question::Closest { "" } else { "      hits" };
        say!("{:16} {:>8}{hits}{wrong}{columns}", "kind", "rays");
    }

    pub fn say_row<'r>(&self, kind: &str, rows: impl Iterator<Item = &'r Row>) {
        let mut line = String::new();
        for (row, method) in rows.zip(self.methods) {
            if line.is_empty() {
                line = format!("{kind:16} {:>8}", row.rays);
                line += &row.hits.map_or_else(String::new, |hits| format!(" {hits:>9}"));
            }
            if self.is_wide {
                line += &format!(" {:>1$}", row.wrong, Self::method_width(method));
            } else {
                line += &format!(" {:>1$}", row.wrong, Self::SORT_WIDTH);
                for count in row.faults.values() {
                    let text = if *count == 0 { String::new() } else { count.to_string() };
                    line += &format!(" {text:>0$}", Self::SORT_WIDTH);
                }
            }
        }
        say!("{}", line.trim_end());
    }

    pub fn say_foot(&self, sheets: &[Sheet]) {
        if !self.is_wide {
            let sheet = &sheets[0];
            say!("{} wrong of {} rays, {:.1} per million", sheet.wrong, sheet.rays, sheet.wrong_per_million);
            return;
        }
        let columns = |text: &dyn Fn(&Sheet) -> String| -> String {
            let pairs = sheets.iter().zip(self.methods);
            pairs.map(|(sheet, method)| format!(" {:>1$}", text(sheet), Self::method_width(method))).collect()
        };
        let width = if self.question == Question::Closest { 25 } else { 35 };
        say!("{:width$}{}", "wrong", columns(&|sheet| sheet.wrong.to_string()));
        say!("{:width$}{}", "per million", columns(&|sheet| format!("{:.0}", sheet.wrong_per_million)));
    }
}
