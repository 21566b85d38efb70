//! XML of bounded size, and numbers in its attributes.

use roxmltree::{Document, Node, ParsingOptions};

use super::error::{Place, TransferFileError, quoted};

/// Elements and texts that a file may have; a colour map of as many points as are read has twice as many.
const MAX_NODES: u32 = 1 << 20;
/// Attributes that an element may have. The parser compares each with all before it, so many of them would take it days.
const MAX_ATTRIBUTES: usize = 1024;

/// The document that `text` holds.
///
/// # Errors
/// It is not well-formed, has a document type (nothing that is read has one), or is too large.
pub(super) fn parse<'t>(text: &'t str, top: &Place<'_>) -> Result<Document<'t>, TransferFileError> {
    if most_attributes(text) > MAX_ATTRIBUTES {
        let expected = format!("at most {MAX_ATTRIBUTES} attributes of an element");
        return Err(top.malformed("", &expected, "more", "is this a preset file?"));
    }
    let options = ParsingOptions {
        nodes_limit: MAX_NODES,
        ..ParsingOptions::default()
    };
    Document::parse_with_options(text, options).map_err(|e| {
        let at = e.pos();
        let place = top.at(format!("line {}, column {}", at.row, at.col));
        place.malformed("", "XML", &e.to_string(), "export the file again")
    })
}

/// At least as many as the attributes of any element: signs of equality between one `<` and the next, which can't be within
/// an attribute.
fn most_attributes(text: &str) -> usize {
    let tags = text.split('<');
    let counts = tags.map(|tag| tag.bytes().filter(|b| *b == b'=').count());
    counts.max().unwrap_or(0)
}

/// The number in an attribute; `None` where there is no such attribute.
///
/// # Errors
/// It is no finite number.
pub(super) fn number(
    element: Node<'_, '_>,
    attribute: &str,
    place: &Place<'_>,
) -> Result<Option<f64>, TransferFileError> {
    let Some(text) = element.attribute(attribute) else {
        return Ok(None);
    };
    let value = text.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    value.map(Some).ok_or_else(|| {
        place.malformed(
            attribute,
            "a finite number",
            &quoted(text),
            "correct the attribute",
        )
    })
}

/// The switch in an attribute, `1` or `true`, `0` or `false`; `None` where there is no such attribute.
///
/// # Errors
/// It is something else.
pub(super) fn switch(
    element: Node<'_, '_>,
    attribute: &str,
    place: &Place<'_>,
) -> Result<Option<bool>, TransferFileError> {
    let Some(text) = element.attribute(attribute) else {
        return Ok(None);
    };
    match text.trim().to_ascii_lowercase().as_str() {
        "1" | "true" => Ok(Some(true)),
        "0" | "false" => Ok(Some(false)),
        _ => Err(place.malformed(attribute, "1 or 0", &quoted(text), "correct the attribute")),
    }
}
