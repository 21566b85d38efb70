//! Which of several points in time or channels is wanted: where there are several, the user says it.

use super::options::OpenOptions;
use super::problem::Subject;
use crate::volume::SourceError;

/// The point in time to read, of `count` (at least 1).
///
/// # Errors
/// There are several and none was chosen, or the chosen one is none of them.
pub(super) fn time(
    subject: &Subject<'_>,
    options: &OpenOptions,
    count: u64,
) -> Result<u64, SourceError> {
    let subject = Subject {
        remedy: "choose one with --time N",
        ..*subject
    };
    one_of(&subject, ("--time", "points in time"), options.time, count)
}

/// The channel to read, of `count` (at least 1).
///
/// # Errors
/// As [`time`].
pub(super) fn channel(
    subject: &Subject<'_>,
    options: &OpenOptions,
    count: u64,
) -> Result<u64, SourceError> {
    let subject = Subject {
        remedy: "choose one with --channel N",
        ..*subject
    };
    one_of(&subject, ("--channel", "channels"), options.channel, count)
}

fn one_of(
    subject: &Subject<'_>,
    (flag, what): (&str, &str),
    chosen: Option<u64>,
    count: u64,
) -> Result<u64, SourceError> {
    let last = count.saturating_sub(1);
    match chosen {
        None if count == 1 => Ok(0),
        Some(n) if n < count => Ok(n),
        Some(n) if count == 1 => {
            let expected = format!("0 or nothing, since the file has no several {what}");
            Err(subject.malformed(flag, expected, n.to_string()))
        }
        chosen => {
            let expected = format!("one of the file's {count} {what}, 0 to {last}");
            let found = chosen.map_or("none chosen".to_owned(), |n| n.to_string());
            Err(subject.malformed(flag, expected, found))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn several_ask_for_a_choice_in_range() {
        let subject = Subject::new(Path::new("a.nii"));
        let chosen = |time, count| {
            let options = OpenOptions {
                time,
                ..OpenOptions::default()
            };
            super::time(&subject, &options, count).map_err(|e| e.to_string())
        };
        assert_eq!(chosen(None, 1), Ok(0), "nothing to choose");
        assert_eq!(chosen(Some(0), 1), Ok(0), "the only one");
        assert_eq!(chosen(Some(4), 5), Ok(4), "the last one");
        let error = chosen(None, 5).unwrap_err();
        assert!(
            error.contains("5 points in time, 0 to 4") && error.contains("--time N"),
            "{error}"
        );
        let error = chosen(Some(5), 5).unwrap_err();
        assert!(error.contains("0 to 4, found 5"), "{error}");
        let error = chosen(Some(1), 1).unwrap_err();
        assert!(error.contains("found 1"), "{error}");
    }
}
