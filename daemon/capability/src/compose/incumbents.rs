//! Whose declaration stands, kept without composing: for who is told much and composes only when
//! somebody looks.
//!
//! What stands depends on who came when, so it cannot wait until then. But it depends on the words
//! about one subject alone: of who came or left, only the own words have to be looked at.

use std::collections::{BTreeMap, BTreeSet};

use super::Party;
use super::declarations::{Variant, variant_of};
use crate::conflict::Subject;
use crate::manifest::{Declaration, Manifest};

/// What stands, of what is known here.
pub(crate) type Incumbents = BTreeMap<Subject, Variant>;

/// Keeps what stands, now that a party says what is in `now` in place of what was in `former`;
/// `parties` are all who are here now, and all trusted or none.
pub(super) fn keep<'a, P: Iterator<Item = Party<'a>>>(
    incumbents: &mut Incumbents,
    former: Option<&Manifest>,
    now: Option<&Manifest>,
    trusted: bool,
    parties: impl Fn() -> P,
) {
    let (former, now) = (words_of(former, trusted), words_of(now, trusted));
    let subjects: BTreeSet<&Subject> = former.keys().chain(now.keys()).copied().collect();
    for subject in subjects {
        let said = now.get(subject).map(|word| variant_of(word));
        let Some(stands) = incumbents.get(subject) else {
            // Nobody else speaks of it.
            incumbents.extend(said.map(|said| (subject.clone(), said)));
            continue;
        };
        let stood_by_it = former.get(subject).is_some_and(|word| variant_of(word) == *stands);
        if stood_by_it && said.as_ref() != Some(stands) {
            choose_again(incumbents, subject, parties());
        }
    }
}

/// Who made what stands does not any more: whoever else does keeps it, or who has been here longest
/// is believed.
fn choose_again<'a>(
    incumbents: &mut Incumbents,
    subject: &Subject,
    parties: impl Iterator<Item = Party<'a>>,
) {
    let Some(stands) = incumbents.remove(subject) else { return };
    let words = parties.filter_map(|party| {
        let word = known(party.manifest, party.trusted).find(|word| word.subject == *subject)?;
        Some((party.arrival, variant_of(word)))
    });
    let order = |(arrival, variant): &(u64, Variant)| (*variant != stands, *arrival);
    let stands = words.min_by_key(order).map(|(_, variant)| (subject.clone(), variant));
    incumbents.extend(stands);
}

fn words_of(manifest: Option<&Manifest>, trusted: bool) -> BTreeMap<&Subject, &Declaration> {
    let known = manifest.into_iter().flat_map(|manifest| known(manifest, trusted));
    known.map(|word| (&word.subject, word)).collect()
}

fn known(manifest: &Manifest, trusted: bool) -> impl Iterator<Item = &Declaration> {
    manifest.declarations.iter().filter(move |declaration| trusted || !declaration.private)
}
