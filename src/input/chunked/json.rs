//! Metadata in JSON: parsing, and fields of the types that formats ask for, with errors that name them.

use serde_json::Value;

use crate::input::problem::{Subject, quoted};
use crate::volume::SourceError;

/// Axes that an array has at most.
const MOST_AXES: usize = 16;

/// Characters of a value that a message shows.
const SHOWN: usize = 80;

/// The JSON object in `bytes`.
///
/// # Errors
/// It is no JSON, or no object.
pub(in crate::input) fn parse(subject: &Subject<'_>, bytes: &[u8]) -> Result<Value, SourceError> {
    let value: Value = serde_json::from_slice(bytes).map_err(|e| {
        subject.malformed(
            format!("line {}, column {}", e.line(), e.column()),
            "metadata in JSON",
            e.to_string(),
        )
    })?;
    if value.is_object() {
        Ok(value)
    } else {
        Err(subject.malformed("the metadata", "a JSON object", shown(&value)))
    }
}

/// A value as a message shows it.
pub(in crate::input) fn shown(value: &Value) -> String {
    match value {
        Value::Null => "nothing".to_owned(),
        Value::String(text) => quoted(text),
        // JSON has its own quotes and escapes.
        other => {
            let text = other.to_string();
            match text.char_indices().nth(SHOWN) {
                Some((end, _)) => format!("{}…", &text[..end]),
                None => text,
            }
        }
    }
}

/// Field `name` of `object`; [`Value::Null`] where there is none.
pub(in crate::input) fn field<'a>(object: &'a Value, name: &str) -> &'a Value {
    object.get(name).unwrap_or(&Value::Null)
}

/// Field `name` as text.
///
/// # Errors
/// It is not there or no text.
pub(in crate::input) fn text<'a>(
    subject: &Subject<'_>,
    object: &'a Value,
    name: &str,
) -> Result<&'a str, SourceError> {
    let value = field(object, name);
    value
        .as_str()
        .ok_or_else(|| wrong(subject, name, "a text", value))
}

/// Field `name` as sizes along the axes of an array, each at least 1.
///
/// # Errors
/// It is not there, or no list of such numbers of a sensible length.
pub(in crate::input) fn sizes(
    subject: &Subject<'_>,
    object: &Value,
    name: &str,
) -> Result<Vec<u64>, SourceError> {
    let value = field(object, name);
    let sizes: Option<Vec<u64>> = value
        .as_array()
        .filter(|list| (1..=MOST_AXES).contains(&list.len()))
        .and_then(|list| list.iter().map(Value::as_u64).collect());
    sizes.filter(|s| !s.contains(&0)).ok_or_else(|| {
        wrong(
            subject,
            name,
            &format!("1 to {MOST_AXES} whole numbers above 0"),
            value,
        )
    })
}

/// Field `name` as `number` finite numbers.
///
/// # Errors
/// It is not there, or not that.
pub(in crate::input) fn numbers(
    subject: &Subject<'_>,
    object: &Value,
    name: &str,
    number: usize,
) -> Result<Vec<f64>, SourceError> {
    let value = field(object, name);
    let numbers: Option<Vec<f64>> = value
        .as_array()
        .and_then(|list| list.iter().map(Value::as_f64).collect());
    numbers
        .filter(|n| n.len() == number && n.iter().all(|v| v.is_finite()))
        .ok_or_else(|| wrong(subject, name, &format!("{number} finite numbers"), value))
}

/// Field `name` is not what it should be.
pub(in crate::input) fn wrong(
    subject: &Subject<'_>,
    name: &str,
    expected: &str,
    found: &Value,
) -> SourceError {
    subject.malformed(format!("field '{name}'"), expected, shown(found))
}
