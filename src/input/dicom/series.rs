//! Which pictures make a volume: those of one series, of one form and orientation, each place once. Pure: no file is read.

use glam::DVec3;

use super::image::{Image, Picture, PixelForm};

/// Directions that differ by less are one.
const SAME_DIRECTION: f64 = 1e-3;
/// Pictures of other forms in a series, at most so many, are left out with a note: they are scouts.
const MOST_SCOUTS: usize = 3;

/// What a series without a UID is called.
const NO_UID: &str = "none";

/// Pictures that can be the slices of a volume.
#[derive(Clone, Debug)]
pub(super) struct Group {
    pub(super) series: String,
    pub(super) modality: String,
    pub(super) description: String,
    pub(super) form: PixelForm,
    pub(super) orientation: Option<[DVec3; 2]>,
    pub(super) pictures: Vec<Picture>,
}

impl Group {
    fn takes(&self, image: &Image, picture: &Picture) -> bool {
        let is_along = match (self.orientation, picture.orientation) {
            (None, None) => true,
            (Some(a), Some(b)) => (0..2).all(|n| a[n].distance(b[n]) < SAME_DIRECTION),
            _ => false,
        };
        self.series == image.series && self.form == image.form && is_along
    }

    /// The group in a line for people.
    fn line(&self) -> String {
        let Self {
            series,
            modality,
            description,
            form,
            pictures,
            ..
        } = self;
        let named = match description.is_empty() {
            true => String::new(),
            false => format!(" '{description}'"),
        };
        let series = match series.as_str() {
            "" => NO_UID,
            series => series,
        };
        format!(
            "{series} ({modality}{named}, {} pictures of {} × {})",
            pictures.len(),
            form.columns,
            form.rows
        )
    }
}

/// The pictures in groups, in the order of their files.
pub(super) fn groups(images: &[Image]) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for image in images {
        for picture in &image.pictures {
            let group = match groups.iter().rposition(|g| g.takes(image, picture)) {
                Some(at) => &mut groups[at],
                None => {
                    groups.push(Group {
                        series: image.series.clone(),
                        modality: image.modality.clone(),
                        description: image.description.clone(),
                        form: image.form,
                        orientation: picture.orientation,
                        pictures: Vec::new(),
                    });
                    let last = groups.len() - 1;
                    &mut groups[last]
                }
            };
            group.pictures.push(picture.clone());
        }
    }
    groups
}

/// Why no group was chosen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Unchosen {
    /// There are several series, one to a line.
    Several(Vec<String>),
    /// None of them is called so.
    NoSuch(Vec<String>),
    /// The series has pictures of several forms.
    Mixed(Vec<String>),
}

/// The group of the series that is `asked` for, or of the only one; remarks go into `notes`.
pub(super) fn choose(
    mut groups: Vec<Group>,
    asked: Option<&str>,
    notes: &mut Vec<String>,
) -> Result<Group, Unchosen> {
    let lines = |groups: &[Group]| groups.iter().map(Group::line).collect::<Vec<_>>();
    if let Some(asked) = asked {
        let all = lines(&groups);
        let is_meant = |g: &Group| match g.series.as_str() {
            "" => asked == NO_UID,
            series => series == asked || series.ends_with(&format!(".{asked}")),
        };
        groups.retain(is_meant);
        if groups.is_empty() {
            return Err(Unchosen::NoSuch(all));
        }
    }
    let is_one = groups
        .windows(2)
        .all(|pair| pair[0].series == pair[1].series);
    if !is_one {
        return Err(Unchosen::Several(lines(&groups)));
    }
    // The largest is the volume if the others are a few pictures: scouts, or a dose report.
    groups.sort_by_key(|g| std::cmp::Reverse(g.pictures.len()));
    let others = groups.split_off(1.min(groups.len()));
    let left_out: usize = others.iter().map(|g| g.pictures.len()).sum();
    let Some(group) = groups.pop() else {
        return Err(Unchosen::Several(Vec::new()));
    };
    if left_out > MOST_SCOUTS || left_out >= group.pictures.len() && left_out > 0 {
        let all = [vec![group], others].concat();
        return Err(Unchosen::Mixed(lines(&all)));
    }
    if left_out > 0 {
        notes.push(format!(
            "{left_out} pictures of the series have another form or orientation than the other {}; they are left out",
            group.pictures.len()
        ));
    }
    Ok(group)
}
