//! Names of actions inside the composite domain.
//!
//! An action has two names. The name outside the composite domain is the name that its agent gave
//! it. Different actions with the same name outside are named `NAME--AGENT` inside the domain,
//! after the agent that offered this variant of the action first. A variant keeps its inside name
//! as long as any agent offers it, so that running plans stay valid when another agent leaves.

use std::collections::{BTreeMap, BTreeSet};

use acl::AgentId;
use pddl::Name;

use crate::canonical::CanonicalText;

/// The variants (different actions) that are offered under each name. Each variant has the agent to
/// name it after: the offering agent that has been present longest.
pub(crate) type ActionVariants<'a> = BTreeMap<&'a Name, BTreeMap<&'a CanonicalText, &'a AgentId>>;

/// Names of actions inside the domain, kept from one composition to the next.
#[derive(Clone, Debug, Default)]
pub(crate) struct ActionNames {
    variants: BTreeMap<Name, BTreeMap<CanonicalText, ActionVariant>>,
}

#[derive(Clone, Debug)]
struct ActionVariant {
    introducer: AgentId,
    qualified: Option<Name>,
}

// === impl ActionNames ===

impl ActionNames {
    /// Returns a name inside the domain for every variant in `live`. The key is the agents' own
    /// name for the action and the canonical text of the schema. Drops the names of all other
    /// variants.
    pub(crate) fn assign<'a>(
        &mut self,
        live: &ActionVariants<'a>,
    ) -> BTreeMap<(&'a Name, &'a CanonicalText), Name> {
        self.remember(live);
        let mut taken: BTreeSet<Name> = self.qualified().cloned().collect();
        let plain: BTreeSet<Name> = self.variants.keys().cloned().collect();
        let mut inside = BTreeMap::new();
        for (outside, keys) in live {
            let Some(variants) = self.variants.get_mut(*outside) else { continue };
            let alone = variants.len() == 1;
            for key in keys.keys() {
                let Some(variant) = variants.get_mut(*key) else { continue };
                // An agent may give an action the name that another action would have inside the
                // domain.
                if variant.qualified.is_none() && (!alone || taken.contains(*outside)) {
                    let wanted = format!("{outside}--{}", variant.introducer);
                    let name = unique(&wanted, |name| taken.contains(name) || plain.contains(name));
                    taken.insert(name.clone());
                    variant.qualified = Some(name);
                }
                let name = variant.qualified.clone().unwrap_or_else(|| (*outside).clone());
                inside.insert((*outside, *key), name);
            }
        }
        inside
    }

    fn remember(&mut self, live: &ActionVariants<'_>) {
        self.variants.retain(|name, _| live.contains_key(name));
        for (outside, keys) in live {
            let variants = self.variants.entry((*outside).clone()).or_default();
            variants.retain(|key, _| keys.contains_key(key));
            for (key, introducer) in keys {
                variants.entry(CanonicalText::clone(key)).or_insert_with(|| ActionVariant {
                    introducer: (*introducer).clone(),
                    qualified: None,
                });
            }
        }
    }

    fn qualified(&self) -> impl Iterator<Item = &Name> {
        self.variants.values().flat_map(BTreeMap::values).filter_map(|v| v.qualified.as_ref())
    }
}

/// Returns the name `wanted` if it is not taken, or else the first of `wanted-2`, `wanted-3`, …
/// that is not taken.
pub(crate) fn unique(wanted: &str, is_taken: impl Fn(&Name) -> bool) -> Name {
    let numbered = (2..).map(|number| Name::new(&format!("{wanted}-{number}")));
    std::iter::once(Name::new(wanted))
        .chain(numbered)
        .find(|name| !is_taken(name))
        .expect("invariant: finitely many names are taken")
}
