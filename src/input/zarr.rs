//! OME-Zarr 0.4 and 0.5, and plain arrays of Zarr formats 2 and 3, in a folder or behind a URL.
//!
//! A location is an image (a group with `multiscales`), a container of images as bioformats2raw writes it, or an array.
//! Level 0 of an image is the volume; the others can be opened by their number. Units become millimetres; scale and
//! translation are kept, axes are not turned: index axes are world axes.

mod chunks;
pub(super) mod element;
mod multiscales;
mod node;
mod v2;
mod v3;

use glam::{DAffine3, U64Vec3};
use serde_json::Value;

use self::chunks::ZarrChunks;
pub(super) use self::multiscales::NO_SPACING;
use self::multiscales::{Image, World, ome};
use self::node::{ArrayNode, Node};
use super::OpenOptions;
use super::chunked::{Axes, Axis, AxisKind, Found, Store, json};
use super::problem::{Subject, quoted};
use crate::volume::{SourceError, VoxelSource};

/// Keys of which one is there wherever something of Zarr lies.
pub(super) const MARKS: &[&str] = &["zarr.json", ".zarray", ".zgroup", ".zattrs"];

/// Opens level `level` of the image at `location`, 0 the finest; an array has that one only.
///
/// # Errors
/// There is none, it can't be fetched, is damaged, or of a kind that is not supported; or there is no such level.
pub(super) fn open_level(
    location: &str,
    options: &OpenOptions,
    level: usize,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    let volume = Volume::find(location, options)?;
    let (array, store, found) = volume.level(level, options)?;
    let place = store.place(array.key);
    let stamp = format!("{}, {}", array.stamp, chosen(&found.axes));
    let chunks = ZarrChunks::new(store, array.layout, stamp);
    found.open(&Subject::new(&place), Box::new(chunks))
}

/// The sizes of all levels of the image at `location`, the finest first.
///
/// # Errors
/// As [`open_level`], for any of them.
pub(super) fn levels(location: &str, options: &OpenOptions) -> Result<Vec<U64Vec3>, SourceError> {
    let volume = Volume::find(location, options)?;
    (0..volume.levels())
        .map(|n| Ok(volume.level(n, options)?.2.dims()))
        .collect()
}

/// Which elements were taken along other axes than those of space: tells volumes of one array apart.
fn chosen(axes: &Axes) -> String {
    let indices: Vec<String> = axes.fixed.iter().map(|(_, i)| i.to_string()).collect();
    format!("at [{}]", indices.join(", "))
}

/// What a location stands for.
struct Volume {
    /// The group of an image, or the array.
    store: Store,
    kind: Kind,
    name: String,
    notes: Vec<String>,
}

enum Kind {
    Image {
        image: Box<Image>,
        key: &'static str,
    },
    Array,
}

impl Volume {
    fn find(location: &str, options: &OpenOptions) -> Result<Self, SourceError> {
        let root = Store::open(location)?;
        let Some(dataset) = &options.dataset else {
            return Self::at(root);
        };
        let store = root.below(dataset)?;
        // An array that is a level of an image keeps its place in the world.
        let names: Vec<&str> = dataset.split('/').filter(|n| !n.is_empty()).collect();
        for cut in (0..names.len()).rev() {
            let (group, path) = names.split_at(cut);
            let group = root.below(&group.join("/"))?;
            if let Some(Node::Group { attributes, key }) = Node::read(&group)? {
                let place = group.place(key);
                let Some(mut image) = Image::parse(&Subject::new(&place), &attributes)? else {
                    continue;
                };
                let path = path.join("/");
                image.levels.retain(|l| l.path.trim_matches('/') == path);
                if !image.levels.is_empty() {
                    return Ok(Self {
                        store: group,
                        kind: Kind::Image {
                            image: Box::new(image),
                            key,
                        },
                        name: store.name(),
                        notes: Vec::new(),
                    });
                }
            }
        }
        Self::at(store)
    }

    /// The volume that lies at the beginning of `store`.
    fn at(store: Store) -> Result<Self, SourceError> {
        let name = store.name();
        let mut notes = Vec::new();
        let path = store.place("");
        let subject = Subject {
            path: &path,
            remedy: "name the group of an image or an array, or say which one below with --dataset PATH",
        };
        let (attributes, key) = match Node::read(&store)? {
            None => {
                let forbidden = if store.was_forbidden() {
                    " (some are answered 403 Forbidden)"
                } else {
                    ""
                };
                return Err(subject.malformed(
                    "the folder",
                    format!("metadata of Zarr ({})", MARKS.join(", ")),
                    format!("none of them{forbidden}"),
                ));
            }
            Some(Node::Array(_)) => {
                return Ok(Self {
                    store,
                    kind: Kind::Array,
                    name,
                    notes,
                });
            }
            Some(Node::Group { attributes, key }) => (attributes, key),
        };
        let place = store.place(key);
        if let Some(image) = Image::parse(&Subject::new(&place), &attributes)? {
            if image.images > 1 {
                notes.push(format!(
                    "The group describes {} images: the first one is read.",
                    image.images
                ));
            }
            return Ok(Self {
                store,
                kind: Kind::Image {
                    image: Box::new(image),
                    key,
                },
                name,
                notes,
            });
        }
        let ome = ome(&attributes);
        for (member, what) in [("plate", "a plate of wells"), ("well", "a well of a plate")] {
            if ome.get(member).is_some() {
                return Err(subject.unsupported(
                    format!("{what} as one volume"),
                    "name one image of it, such as A/1/0, with --dataset PATH",
                ));
            }
        }
        if ome.get("bioformats2raw.layout").is_some() {
            let (first, number) = series(&store)?;
            let number = number.map_or("several".to_owned(), |n| n.to_string());
            notes.push(format!(
                "The container may hold {number} images: {} is read; --dataset chooses another.",
                quoted(&first)
            ));
            return Self::in_container(&subject, store.below(&first)?, (name, notes));
        }
        let children = store.children();
        let below = if children.is_empty() {
            String::new()
        } else {
            format!("; below are {}", quoted(&children.join(", ")))
        };
        Err(subject.malformed(
            "the group",
            "an image (multiscales) or an array",
            format!("neither{below}"),
        ))
    }

    /// The image in a container, which is no container itself.
    fn in_container(
        subject: &Subject<'_>,
        store: Store,
        (name, notes): (String, Vec<String>),
    ) -> Result<Self, SourceError> {
        let node = Node::read(&store)?;
        if let Some(Node::Group { attributes, key }) = node {
            let place = store.place(key);
            if let Some(image) = Image::parse(&Subject::new(&place), &attributes)? {
                return Ok(Self {
                    store,
                    kind: Kind::Image {
                        image: Box::new(image),
                        key,
                    },
                    name,
                    notes,
                });
            }
        }
        Err(subject.malformed(
            "the container of bioformats2raw",
            format!("an image in {}", quoted(&store.name())),
            "none",
        ))
    }

    fn levels(&self) -> usize {
        match &self.kind {
            Kind::Image { image, .. } => image.levels.len(),
            Kind::Array => 1,
        }
    }

    /// The array of a level, where it lies, and how it becomes a volume.
    fn level(
        &self,
        number: usize,
        options: &OpenOptions,
    ) -> Result<(ArrayNode, Store, Found), SourceError> {
        let path = self.store.place("");
        let subject = Subject::new(&path);
        if number >= self.levels() {
            return Err(subject.malformed(
                "the levels",
                format!("0 to {}", self.levels() - 1),
                number.to_string(),
            ));
        }
        let store = match &self.kind {
            Kind::Image { image, .. } => self.store.below(&image.levels[number].path)?,
            Kind::Array => self.store.clone(),
        };
        let Some(Node::Array(array)) = Node::read(&store)? else {
            return Err(subject.malformed(
                format!("level {number}"),
                format!("an array in {}", store.place("").display()),
                "none",
            ));
        };
        let place = match &self.kind {
            Kind::Image { key, .. } => self.store.place(key),
            Kind::Array => store.place(array.key),
        };
        let subject = Subject::new(&place);
        let shape = &array.layout.array.shape;
        let (axes, transform, channels) = match &self.kind {
            Kind::Image { image, .. } => (
                image.axes.clone(),
                image.levels[number].place.as_ref(),
                image.channels.as_slice(),
            ),
            Kind::Array => (plain_axes(&subject, &array)?, None, &[][..]),
        };
        let chosen = Axes::choose(&subject, &axes, shape, channels, options)?;
        let world = World::of(&subject, &axes, &chosen, transform, options.spacing)?;
        let (mut world_from_index, mut unit) = (None, String::new());
        if let Kind::Image { image, .. } = &self.kind {
            unit.clone_from(&image.unit);
            // Of a coarser level: what the levels' scales and places say of it, within the first one.
            let first = image.levels[0].place.as_ref();
            let first = World::of(&subject, &axes, &chosen, first, options.spacing)?;
            world_from_index = image.world_from_first.map(|world_from_first| {
                let scale = world.spacing / first.spacing;
                let begin = (world.origin - first.origin) / first.spacing;
                world_from_first * DAffine3::from_translation(begin) * DAffine3::from_scale(scale)
            });
        }
        let mut notes = self.notes.clone();
        notes.extend(world.notes);
        let found = Found {
            array: array.layout.array.clone(),
            axes: chosen,
            spacing: world.spacing,
            origin: world.origin,
            world_from_index,
            unit,
            name: self.name.clone(),
            notes,
            is_remote: store.is_remote(),
        };
        Ok((*array, store, found))
    }
}

/// The axes of an array without an image: by their names, or z, y, x as the last of them.
fn plain_axes(subject: &Subject<'_>, array: &ArrayNode) -> Result<Vec<Axis>, SourceError> {
    let shape = &array.layout.array.shape;
    if let Some(names) = &array.names
        && names.len() == shape.len()
    {
        let axes: Vec<Axis> = names.iter().map(|n| Axis::named(n)).collect();
        let space = axes.iter().filter(|a| a.kind == AxisKind::Space).count();
        if space >= 2 {
            return Ok(axes);
        }
    }
    let lead = shape.len().saturating_sub(3);
    if shape[..lead].iter().any(|&s| s > 1) {
        return Err(subject.unsupported(
            format!("an array of {shape:?} elements whose axes have no names"),
            "supported are arrays of z, y, x; other axes must be named (OME-Zarr) or have one element",
        ));
    }
    let names = ["z", "y", "x"];
    let tail = &names[names.len().saturating_sub(shape.len())..];
    let others = (0..lead).map(|n| format!("axis {n}"));
    let axes = others.chain(tail.iter().map(|&n| n.to_owned()));
    Ok(axes.map(|n| Axis::named(&n)).collect())
}

/// The first image of a container, and how many there are where that is said.
fn series(store: &Store) -> Result<(String, Option<usize>), SourceError> {
    let described = match Node::read(&store.below("OME")?)? {
        Some(Node::Group { attributes, .. }) => attributes,
        _ => Value::Null,
    };
    let list = json::field(ome(&described), "series").as_array();
    let first = list.and_then(|l| l.first()?.as_str());
    Ok((first.unwrap_or("0").to_owned(), list.map(Vec::len)))
}

#[cfg(test)]
mod tests;
