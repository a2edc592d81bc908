//! Pieces of XML: attributes by their names.

use crate::scene::text::{number, quote};
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use quick_xml::name::QName;
use std::borrow::Cow;

/// The value of attribute `name` of the element's own namespace: those of others have prefixes.
fn attribute<'e>(element: &'e BytesStart, name: &str) -> Option<Cow<'e, str>> {
    find(element, |key| key.as_ref() == name)
}

/// Whether an element says that what it names is in another part; the production extension's attribute for that has
/// whatever prefix a file gives the extension.
pub(super) fn has_path(element: &BytesStart) -> bool {
    find(element, |key| key.local_name().as_ref() == "path").is_some()
}

/// The value of the first attribute whose key is `wanted`.
pub(super) fn find<'e>(element: &'e BytesStart, wanted: impl Fn(QName) -> bool) -> Option<Cow<'e, str>> {
    let mut all = element.attributes();
    all.with_checks(false).flatten().find(|attribute| wanted(attribute.key)).map(|attribute| attribute.value)
}

/// An attribute as text.
pub(super) fn text(element: &BytesStart, name: &str) -> Option<String> {
    attribute(element, name).map(Cow::into_owned)
}

/// An attribute that must be a number.
pub(super) fn float(element: &BytesStart, name: &str) -> Result<f32, String> {
    let value = required(element, name)?;
    number(value.trim().as_bytes()).ok_or_else(|| wrong(element, name, &value))
}

/// An attribute that must be a whole number.
pub(super) fn whole(element: &BytesStart, name: &str) -> Result<u32, String> {
    let value = required(element, name)?;
    parse_whole(&value).ok_or_else(|| wrong(element, name, &value))
}

/// An attribute that is a whole number where there is one.
pub(super) fn optional_whole(element: &BytesStart, name: &str) -> Result<Option<u32>, String> {
    let Some(value) = attribute(element, name) else { return Ok(None) };
    parse_whole(&value).map(Some).ok_or_else(|| wrong(element, name, &value))
}

fn parse_whole(value: &str) -> Option<u32> {
    value.trim().parse().ok()
}

fn required<'e>(element: &'e BytesStart, name: &str) -> Result<Cow<'e, str>, String> {
    attribute(element, name).ok_or_else(|| format!("an element '{}' has no '{name}'", name_of(element)))
}

fn wrong(element: &BytesStart, name: &str, value: &str) -> String {
    format!("an element '{}' has {name} = '{}', which is no such number", name_of(element), quote(value.as_bytes()))
}

/// The local name of an element, for messages.
pub(super) fn name_of(element: &BytesStart) -> String {
    quote(element.local_name().as_ref().as_bytes())
}

/// The target of the relationship in `text` whose type ends with `kind`.
pub(super) fn target_of(text: &[u8], kind: &str) -> Option<String> {
    let mut reader = Reader::from_reader(text);
    loop {
        match reader.read_event().ok()? {
            Event::Eof => return None,
            Event::Start(element) | Event::Empty(element) => {
                let is_wanted = attribute(&element, "Type").is_some_and(|value| value.ends_with(kind));
                if let Some(target) = attribute(&element, "Target").filter(|_| is_wanted) {
                    return Some(target.into_owned());
                }
            }
            _ => {}
        }
    }
}
