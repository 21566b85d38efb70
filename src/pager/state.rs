//! The states of a brick and every legal move between them.

use thiserror::Error;

use super::SlotId;

/// Where a brick is. Exactly one at a time (design.md §1).
///
/// | from \ event | Request | Start | Decoded | Failed | Place | Evict | Drop | Retry |
/// |---|---|---|---|---|---|---|---|---|
/// | Absent   | Queued | – | – | – | – | – | – | – |
/// | Queued   | – | Decoding | – | – | – | – | Absent | – |
/// | Decoding | – | – | InRam | Failed | – | – | Absent | – |
/// | InRam    | – | – | – | – | Resident | – | Absent | – |
/// | Resident | – | – | – | – | – | InRam | Absent | – |
/// | Failed   | – | – | – | – | – | – | – | Absent |
///
/// A resident brick may have a copy in host memory besides: evicted, it is InRam with one and Absent without.
/// `Constant` bricks have no voxels and never move; `Empty` is not a state but the absence of a request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BrickState {
    /// Only in the store.
    #[default]
    Absent,
    /// Asked for.
    Queued,
    /// Ordered from the loader.
    Decoding,
    /// Decoded, in host memory, without a slot.
    InRam,
    /// In the atlas.
    Resident(SlotId),
    /// One value: lives in the page table alone.
    Constant,
    /// Could not be read; not tried again until it is said to.
    Failed,
}

/// What happens to a brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A picture wants it.
    Request,
    /// The loader gets the order.
    Start,
    /// Its voxels are in host memory.
    Decoded,
    /// It can't be read.
    Failed,
    /// It gets a slot.
    Place(SlotId),
    /// Its slot is given to another; its copy in host memory stays.
    Evict,
    /// It is forgotten: a request or an order that is cancelled, or the last copy of its voxels given up.
    Drop,
    /// What could not be read may be tried again.
    Retry,
}

/// A move that the table doesn't have: a bug.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("a brick that is {from:?} can't take {event:?}")]
#[expect(missing_docs, reason = "the message names both")]
pub struct IllegalMove {
    pub from: BrickState,
    pub event: Event,
}

/// The state after `event`.
///
/// # Errors
/// The table has no such move.
pub fn transition(from: BrickState, event: Event) -> Result<BrickState, IllegalMove> {
    use BrickState as S;
    match (from, event) {
        (S::Absent, Event::Request) => Ok(S::Queued),
        (S::Queued, Event::Start) => Ok(S::Decoding),
        (S::Decoding, Event::Decoded) | (S::Resident(_), Event::Evict) => Ok(S::InRam),
        (S::Decoding, Event::Failed) => Ok(S::Failed),
        (S::InRam, Event::Place(slot)) => Ok(S::Resident(slot)),
        (S::Queued | S::Decoding | S::InRam | S::Resident(_), Event::Drop)
        | (S::Failed, Event::Retry) => Ok(S::Absent),
        _ => Err(IllegalMove { from, event }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_tables_moves_are_legal() {
        use BrickState as S;
        let slot = SlotId(3);
        let states = [
            S::Absent,
            S::Queued,
            S::Decoding,
            S::InRam,
            S::Resident(slot),
            S::Constant,
            S::Failed,
        ];
        let events = [
            Event::Request,
            Event::Start,
            Event::Decoded,
            Event::Failed,
            Event::Place(slot),
            Event::Evict,
            Event::Drop,
            Event::Retry,
        ];
        let legal: Vec<(S, Event, S)> = states
            .into_iter()
            .flat_map(|s| events.map(move |e| (s, e)))
            .filter_map(|(s, e)| transition(s, e).ok().map(|to| (s, e, to)))
            .collect();
        assert_eq!(
            legal,
            [
                (S::Absent, Event::Request, S::Queued),
                (S::Queued, Event::Start, S::Decoding),
                (S::Queued, Event::Drop, S::Absent),
                (S::Decoding, Event::Decoded, S::InRam),
                (S::Decoding, Event::Failed, S::Failed),
                (S::Decoding, Event::Drop, S::Absent),
                (S::InRam, Event::Place(slot), S::Resident(slot)),
                (S::InRam, Event::Drop, S::Absent),
                (S::Resident(slot), Event::Evict, S::InRam),
                (S::Resident(slot), Event::Drop, S::Absent),
                (S::Failed, Event::Retry, S::Absent),
            ],
            "the state table of the docs"
        );
    }
}
