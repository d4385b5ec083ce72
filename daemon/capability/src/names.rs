//! The names of actions inside the composite domain.
//!
//! Outside, an action has the name its agent gave it. Inside, unequal actions of one name are
//! told apart as `NAME--AGENT`, where the agent is the one that brought that variant first. A
//! variant keeps a name once qualified for as long as anyone offers it, so that plans on their
//! way do not lose their words when somebody else leaves.

use std::collections::{BTreeMap, BTreeSet};

use acl::AgentId;
use pddl::Name;

use crate::canonical::Key;

/// The offered variants of each name, each with the agent to name it after: of those that offer
/// it, the one here longest.
pub(crate) type Variants<'a> = BTreeMap<&'a Name, BTreeMap<&'a Key, &'a AgentId>>;

/// What is remembered of names from one composition to the next.
#[derive(Clone, Debug, Default)]
pub(crate) struct ActionNames {
    variants: BTreeMap<Name, BTreeMap<Key, Variant>>,
}

#[derive(Clone, Debug)]
struct Variant {
    introducer: AgentId,
    qualified: Option<Name>,
}

// === impl ActionNames ===

impl ActionNames {
    /// Names every live variant. What is no longer live is forgotten.
    pub(crate) fn assign<'a>(
        &mut self,
        live: &Variants<'a>,
    ) -> BTreeMap<(&'a Name, &'a Key), Name> {
        self.remember(live);
        let mut taken: BTreeSet<Name> = self.qualified().cloned().collect();
        let plain: BTreeSet<Name> = self.variants.keys().cloned().collect();
        let mut inside = BTreeMap::new();
        for (outside, keys) in live {
            let Some(variants) = self.variants.get_mut(*outside) else { continue };
            let alone = variants.len() == 1;
            for key in keys.keys() {
                let Some(variant) = variants.get_mut(*key) else { continue };
                // A foreign action may be spelled like a qualified one.
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

    fn remember(&mut self, live: &Variants<'_>) {
        self.variants.retain(|name, _| live.contains_key(name));
        for (outside, keys) in live {
            let variants = self.variants.entry((*outside).clone()).or_default();
            variants.retain(|key, _| keys.contains_key(key));
            for (key, introducer) in keys {
                variants.entry(Key::clone(key)).or_insert_with(|| Variant {
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

/// `wanted`, or the first of `wanted-2`, `wanted-3`, … that is not taken.
pub(crate) fn unique(wanted: &str, is_taken: impl Fn(&Name) -> bool) -> Name {
    let numbered = (2..).map(|number| Name::new(&format!("{wanted}-{number}")));
    std::iter::once(Name::new(wanted))
        .chain(numbered)
        .find(|name| !is_taken(name))
        .expect("invariant: finitely many names are taken")
}
