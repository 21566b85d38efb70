//! A report held against an older one: old ÷ new of each time, so that more than 1 is faster.

use serde::Serialize;

use super::report::{Report, Row};
use super::summary::rounded;

/// A row against its partner.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ratios {
    /// What was measured.
    pub name: String,
    /// Old ÷ new by name of the time; `None` where either was not measured or the new one is 0.
    pub ratios: Vec<(&'static str, Option<f64>)>,
}

/// What two reports have in common, and what not.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison<'a, R> {
    old: &'a Report<R>,
    /// Which old rows have found a partner.
    taken: Vec<bool>,
}

impl<'a, R: Row> Comparison<'a, R> {
    /// Against `old`; nothing compared yet.
    pub fn new(old: &'a Report<R>) -> Self {
        Self {
            old,
            taken: vec![false; old.rows.len()],
        }
    }

    /// The ratios of `row` against the old row of the same name; `None` where there is none. Of several of one name each
    /// is a partner once, in order.
    pub fn ratios(&mut self, row: &R) -> Option<Ratios> {
        let name = row.name();
        let place = (self.old.rows.iter().zip(&self.taken))
            .position(|(old, taken)| !taken && old.name() == name)?;
        self.taken[place] = true;
        let ratios = (self.old.rows[place].times().into_iter().zip(row.times()))
            .map(|((time, old), (_, new))| {
                let ratio = old
                    .zip(new)
                    .filter(|&(_, new)| new > 0.0)
                    .map(|(old, new)| rounded(old / new));
                (time, ratio)
            })
            .collect();
        Some(Ratios { name, ratios })
    }

    /// Names of the old rows that no new one was compared with.
    pub fn without_partner(&self) -> Vec<String> {
        (self.old.rows.iter().zip(&self.taken))
            .filter(|(_, taken)| !**taken)
            .map(|(row, _)| row.name())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::report::tests::report;
    use super::*;

    #[test]
    fn rows_find_their_partners_by_name_and_in_order() {
        let old = report(&[
            ("a", Some(30.0)),
            ("a", Some(10.0)),
            ("b", Some(5.0)),
            ("c", None),
        ]);
        let new = report(&[
            ("c", Some(1.0)),
            ("a", Some(10.0)),
            ("a", Some(20.0)),
            ("a", Some(1.0)),
            ("d", Some(1.0)),
        ]);
        let mut comparison = Comparison::new(&old);
        let ratios: Vec<Option<Option<f64>>> = new
            .rows
            .iter()
            .map(|row| comparison.ratios(row).map(|r| r.ratios[0].1))
            .collect();
        // c was not measured before; the third a and d have no partner.
        let expected = [Some(None), Some(Some(3.0)), Some(Some(0.5)), None, None];
        assert_eq!(ratios, expected);
        assert_eq!(comparison.without_partner(), ["b"]);
    }

    #[test]
    fn a_report_against_itself_is_1() {
        let report = report(&[("a", Some(30.0)), ("b", Some(0.5))]);
        let mut comparison = Comparison::new(&report);
        for row in &report.rows {
            let found = comparison.ratios(row).unwrap();
            assert_eq!(found.ratios, [("cpu_ms", Some(1.0))], "{found:?}");
        }
        assert!(comparison.without_partner().is_empty());
    }
}
