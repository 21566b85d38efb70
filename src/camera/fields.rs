//! Fields of a JSON object, for the files of cameras and of their paths.

use glam::DVec3;
use serde_json::{Map, Value};

/// The three finite numbers of a field; `None` when something else is there, or nothing.
pub(super) fn vec3(fields: &Map<String, Value>, name: &str) -> Option<DVec3> {
    let [x, y, z] = fields.get(name)?.as_array()?.as_slice() else {
        return None;
    };
    Some(DVec3::new(x.as_f64()?, y.as_f64()?, z.as_f64()?))
}

/// What a field holds, for messages.
pub(super) fn found(fields: &Map<String, Value>, name: &str) -> String {
    fields.get(name).map_or_else(|| "nothing".to_owned(), short)
}

/// The start of a JSON value, for messages.
pub(super) fn short(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}
