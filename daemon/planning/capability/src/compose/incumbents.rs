//! Tracks the declaration in force for each part of the models, without composing. Maintainers that
//! receive many models and compose only on request use this.
//!
//! The order of arrival decides which declaration is in force, so the tracking cannot wait for the
//! composition. However, each part is independent of the others: if an agent joins or leaves, only
//! the parts that it declares are checked.

use std::collections::{BTreeMap, BTreeSet};

use super::Contribution;
use super::declarations::{DeclarationVariant, variant_of};
use crate::conflict::ModelPart;
use crate::model_summary::{Declaration, ModelSummary};

/// The declaration that is in force for each declared part of the models.
pub(crate) type DeclarationsInForce = BTreeMap<ModelPart, DeclarationVariant>;

/// Updates the declarations in force, after the model of one agent has changed from `former` to
/// `now`. `parties` are all present agents. If `trusted` is true, their whole models are used, and
/// otherwise only the public parts.
pub(super) fn update<'a, P: Iterator<Item = Contribution<'a>>>(
    incumbents: &mut DeclarationsInForce,
    former: Option<&ModelSummary>,
    now: Option<&ModelSummary>,
    trusted: bool,
    parties: impl Fn() -> P,
) {
    let (former, now) = (words_of(former, trusted), words_of(now, trusted));
    let subjects: BTreeSet<&ModelPart> = former.keys().chain(now.keys()).copied().collect();
    for subject in subjects {
        let said = now.get(subject).map(|word| variant_of(word));
        let Some(stands) = incumbents.get(subject) else {
            // No other agent declares the subject.
            incumbents.extend(said.map(|said| (subject.clone(), said)));
            continue;
        };
        let stood_by_it = former.get(subject).is_some_and(|word| variant_of(word) == *stands);
        if stood_by_it && said.as_ref() != Some(stands) {
            choose_again(incumbents, subject, parties());
        }
    }
}

/// Chooses the declaration in force again, after an agent has ceased to make the current one. If
/// another agent also makes the current declaration, nothing changes. Otherwise the declaration of
/// the agent that has been present longest comes into force.
fn choose_again<'a>(
    incumbents: &mut DeclarationsInForce,
    subject: &ModelPart,
    parties: impl Iterator<Item = Contribution<'a>>,
) {
    let Some(stands) = incumbents.remove(subject) else { return };
    let words = parties.filter_map(|party| {
        let word = known(party.manifest, party.trusted).find(|word| word.subject == *subject)?;
        Some((party.arrival, variant_of(word)))
    });
    let order = |(arrival, variant): &(u64, DeclarationVariant)| (*variant != stands, *arrival);
    let stands = words.min_by_key(order).map(|(_, variant)| (subject.clone(), variant));
    incumbents.extend(stands);
}

fn words_of(manifest: Option<&ModelSummary>, trusted: bool) -> BTreeMap<&ModelPart, &Declaration> {
    let known = manifest.into_iter().flat_map(|manifest| known(manifest, trusted));
    known.map(|word| (&word.subject, word)).collect()
}

fn known(manifest: &ModelSummary, trusted: bool) -> impl Iterator<Item = &Declaration> {
    manifest.declarations.iter().filter(move |declaration| trusted || !declaration.private)
}
