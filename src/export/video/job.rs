//! Two jobs beside each other: in what they differ.

use serde_json::Value;

/// Longest value that a message shows.
const LONGEST: usize = 60;
/// Differences that are named at most.
const MOST: usize = 4;

/// In what two descriptions differ, in words: at most four places, each with what is in `there` and in `here`.
pub fn differences(there: &Value, here: &Value) -> Vec<String> {
    let mut found = Vec::new();
    compare("", Some(there), Some(here), &mut found);
    let more = found.len().saturating_sub(MOST);
    found.truncate(MOST);
    if more > 0 {
        found.push(format!("and {more} more"));
    }
    found
}

fn compare(place: &str, there: Option<&Value>, here: Option<&Value>, found: &mut Vec<String>) {
    match (there, here) {
        (Some(Value::Object(a)), Some(Value::Object(b))) => {
            let keys = a.keys().chain(b.keys().filter(|k| !a.contains_key(*k)));
            for key in keys {
                let dot = if place.is_empty() { "" } else { "." };
                compare(&format!("{place}{dot}{key}"), a.get(key), b.get(key), found);
            }
        }
        _ if there == here => (),
        _ => found.push(format!(
            "{place} is {} there, now {}",
            short(there),
            short(here)
        )),
    }
}

fn short(value: Option<&Value>) -> String {
    let text = match value {
        None => return "nothing".into(),
        Some(Value::String(text)) => text.clone(),
        Some(value) => value.to_string(),
    };
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn differences_are_named() {
        let a = json!({"size": [4, 3], "settings": {"mode": "iso", "step": 0.5}, "old": 1});
        assert!(differences(&a, &a.clone()).is_empty(), "the same");
        let b = json!({"size": [8, 3], "settings": {"mode": "mip", "step": 0.5}, "new": "x"});
        assert_eq!(
            differences(&a, &b),
            [
                "old is 1 there, now nothing",
                "settings.mode is iso there, now mip",
                "size is [4,3] there, now [8,3]",
                "new is nothing there, now x"
            ]
        );
        let many = json!({"a": 1, "b": 2, "c": 3, "d": 4, "e": 5, "f": 6});
        assert_eq!(differences(&many, &json!({})).last().unwrap(), "and 2 more");
    }
}
