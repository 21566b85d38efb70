//! [`Node`]: what lies at a path of a Zarr hierarchy, a group or an array, of format 2 or 3.

use serde_json::Value;

use super::chunks::Layout;
use super::{v2, v3};
use crate::input::chunked::{Store, json};
use crate::input::problem::Subject;
use crate::volume::SourceError;

/// A group or an array.
pub(super) enum Node {
    Group {
        attributes: Value,
        /// Key of the metadata, for messages.
        key: &'static str,
    },
    Array(Box<ArrayNode>),
}

/// An array as its metadata describe it.
pub(super) struct ArrayNode {
    pub(super) layout: Layout,
    /// Names of the axes, where they have some.
    pub(super) names: Option<Vec<String>>,
    /// Key of the metadata.
    pub(super) key: &'static str,
    /// Tells these metadata from others.
    pub(super) stamp: String,
}

impl Node {
    /// What lies at the beginning of `store`; `None` where there is no metadata of Zarr.
    ///
    /// # Errors
    /// The metadata can't be fetched or understood.
    pub(super) fn read(store: &Store) -> Result<Option<Self>, SourceError> {
        let get = |key| -> Result<Option<(Value, Vec<u8>)>, SourceError> {
            let Some(bytes) = store.metadata(key)? else {
                return Ok(None);
            };
            let place = store.place(key);
            Ok(Some((json::parse(&Subject::new(&place), &bytes)?, bytes)))
        };
        let stamp = |key, bytes: &[u8]| {
            let hash = xxhash_rust::xxh3::xxh3_64(bytes);
            format!("metadata {hash:016x} {}", store.changed(key))
        };
        if let Some((value, bytes)) = get("zarr.json")? {
            let place = store.place("zarr.json");
            return v3::node(&Subject::new(&place), value, stamp("zarr.json", &bytes)).map(Some);
        }
        if let Some((value, bytes)) = get(".zarray")? {
            let place = store.place(".zarray");
            let attributes = get(".zattrs")?.map_or(Value::Null, |(v, _)| v);
            let array = v2::array(
                &Subject::new(&place),
                &value,
                &attributes,
                stamp(".zarray", &bytes),
            )?;
            return Ok(Some(Self::Array(Box::new(array))));
        }
        let group = get(".zgroup")?;
        if let Some((value, _)) = &group {
            let place = store.place(".zgroup");
            check_format(&Subject::new(&place), value, 2)?;
        }
        // Attributes alone count as a group: some writers leave the other file out.
        let attributes = get(".zattrs")?.map(|(v, _)| v);
        if group.is_none() && attributes.is_none() {
            return Ok(None);
        }
        Ok(Some(Self::Group {
            attributes: attributes.unwrap_or(Value::Null),
            key: ".zattrs",
        }))
    }
}

/// Refuses metadata of another version than `format`.
pub(super) fn check_format(
    subject: &Subject<'_>,
    metadata: &Value,
    format: u64,
) -> Result<(), SourceError> {
    let found = json::field(metadata, "zarr_format");
    if found.as_u64() == Some(format) {
        return Ok(());
    }
    Err(json::wrong(
        subject,
        "zarr_format",
        &format!("{format} (Zarr formats 2 and 3 are supported)"),
        found,
    ))
}
