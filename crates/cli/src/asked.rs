//! What `raybrook stress --ask` asks, and wrong answers beside the exact ones, in words.

use super::values::Named;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use raybrook::low_level::shared::{Hit, NO_PRIMITIVE};
use raybrook_lab::stress::{Exact, Given, Question};

/// The names of questions, as an option takes them.
pub(super) fn parser() -> Named<impl TypedValueParser<Value = Question>> {
    let names = || Question::ALL.map(|question| PossibleValue::new(question.name()).help(question.about()));
    let question = |name: String| Question::ALL.into_iter().find(|question| question.name() == name);
    let parser = PossibleValuesParser::new(names()).map(move |name| question(name).unwrap_or_default());
    Named::new(names(), parser)
}

/// The exact answer for a ray, and the one that was given.
pub(super) fn say_answers(exact: &Exact, given: &Given, ray: usize) {
    match (exact, given) {
        (Exact::Closest(answers), Given::Hits(found)) => {
            let (exact, exact_next) = answers.rounded(ray);
            say!("  exact  {}", hit_in_words(&exact));
            say!("  found  {}", hit_in_words(&found.hits[ray]));
            if let (Some(exact), Some(hits)) = (exact_next, &found.next_hits) {
                say!("  exact second  {}", hit_in_words(&exact));
                say!("  found second  {}", hit_in_words(&hits[ray]));
            }
        }
        (Exact::Lists(lists, question), Given::Lists(found)) => {
            let due = question.hits(lists, ray);
            let hits = &found.hits[ray];
            let are_same = due.iter().zip(hits).take_while(|(due, hit)| due == hit).count();
            say!("  exact  {}", list_in_words(&due, are_same));
            say!("  found  {}", list_in_words(hits, are_same));
            if let Some(crossings) = &found.crossings {
                say!("  exact crossings  {}", lists.crossings(ray));
                say!("  found crossings  {}", crossings[ray]);
            }
        }
        _ => {}
    }
}

fn hit_in_words(hit: &Hit) -> String {
    if hit.primitive == NO_PRIMITIVE {
        return "miss".into();
    }
    format!("triangle {} t {:e} u {:e} v {:e}", hit.primitive, hit.t, hit.u, hit.v)
}

/// How many hits a list has, and the first few from where it differs from another one.
fn list_in_words(hits: &[Hit], are_same: usize) -> String {
    const SHOWN: usize = 3;
    let rest = hits.iter().enumerate().skip(are_same).take(SHOWN);
    let shown: String = rest.map(|(i, hit)| format!("\n    {i}: {}", hit_in_words(hit))).collect();
    format!("{} hits{shown}", hits.len())
}
