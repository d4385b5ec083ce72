//! Converts sets of suppositions to alternatives: the agents that would have to be present, and
//! their places.
//!
//! The places of a new agent are found by trial: the relaxed task is explored once for each place,
//! without all other places of the agent.

use std::collections::{BTreeMap, BTreeSet};

use pddl::Name;

use super::support::{PlaceGroup, RuleOrigin, Support, SuppositionRules, SuppositionSet};
use super::suppose::SupposedTask;
use super::{
    ALTERNATIVES_MAX, Alternative, MissingCapability, Placement, RequiredPlace, SupposedObject,
};

/// Maximum number of places that are tried for one fact about one new agent; further places are not
/// listed in the explanation.
const PLACES_MAX: usize = 128;

/// Limit on the number of rules visited in all explorations together. After it is reached, the
/// explanation is incomplete. Visiting this many rules takes about a second.
const STEPS_MAX: u64 = 50_000_000;

/// The alternatives for each part of the goal.
pub(super) struct FoundAlternatives {
    pub(super) of: BTreeMap<usize, Vec<Alternative>>,
    pub(super) is_complete: bool,
}

struct PlacementSearch<'a> {
    rules: &'a SuppositionRules,
    supposed: &'a SupposedTask,
    steps: u64,
    is_complete: bool,
}

/// Computes the alternatives for the parts of the goal in `asked`.
pub(super) fn places(
    rules: &SuppositionRules,
    support: &Support,
    supposed: &SupposedTask,
    asked: &[usize],
) -> FoundAlternatives {
    let mut search = PlacementSearch { rules, supposed, steps: 0, is_complete: true };
    let chosen: BTreeMap<usize, Vec<SuppositionSet>> =
        asked.iter().map(|part| (*part, search.choose(support.sets(*part)))).collect();
    let sets: BTreeSet<SuppositionSet> = chosen.values().flatten().copied().collect();
    let mut placed: BTreeMap<SuppositionSet, BTreeMap<usize, Vec<(u32, Placement)>>> =
        BTreeMap::new();
    for set in sets {
        let parts = chosen.iter().filter(|(_, sets)| sets.contains(&set)).map(|(part, _)| *part);
        let parts: BTreeSet<usize> = parts.collect();
        placed.insert(set, search.place(&set, &parts));
    }
    let mut of = BTreeMap::new();
    for (part, sets) in chosen {
        let placements = |set: &SuppositionSet| placed.get(set).and_then(|parts| parts.get(&part));
        let mut alternatives: Vec<Alternative> = Vec::new();
        for set in &sets {
            let placements = placements(set).map_or(&[] as &[_], Vec::as_slice);
            let alternative = search.alternative(set, placements);
            // Two action models may use the same name for different actions.
            if !alternatives.contains(&alternative) {
                alternatives.push(alternative);
            }
        }
        alternatives.truncate(ALTERNATIVES_MAX);
        of.insert(part, alternatives);
    }
    FoundAlternatives { of, is_complete: search.is_complete }
}

// === impl PlacementSearch ===

impl PlacementSearch<'_> {
    /// Selects the first few of `sets`. Small sets come before large ones, and sets with present
    /// agents before sets with new agents. Of sets with the same agents and the same action names,
    /// one is selected, because they may become equal alternatives.
    fn choose(&self, sets: &[SuppositionSet]) -> Vec<SuppositionSet> {
        let new = |set: &&SuppositionSet| {
            let agents = set.members().iter().map(|member| self.who(*member));
            agents.filter(|who| matches!(who, SupposedObject::New(_))).count()
        };
        let mut sets: Vec<&SuppositionSet> = sets.iter().collect();
        sets.sort_by_key(|set| (set.members().len(), new(set), **set));
        let mut kinds: Vec<Vec<(&Name, SupposedObject)>> = Vec::new();
        let is_chosen = |set: &&SuppositionSet| {
            let kind = set.members().iter().map(|member| (self.action(*member), self.who(*member)));
            let kind = kind.collect();
            if !kinds.contains(&kind) {
                kinds.push(kind);
            }
            kinds.len() <= ALTERNATIVES_MAX
        };
        sets.into_iter().take_while(is_chosen).copied().collect()
    }

    /// Returns the name of the action of a supposition in the agents' own models.
    fn action(&self, supposition: u32) -> &Name {
        let (capability, _) = &self.rules.suppositions[supposition as usize];
        &self.supposed.capabilities[*capability].outside
    }

    fn who(&self, supposition: u32) -> SupposedObject {
        let (_, agent) = &self.rules.suppositions[supposition as usize];
        self.supposed.who(agent)
    }

    fn alternative(&self, set: &SuppositionSet, placements: &[(u32, Placement)]) -> Alternative {
        let missing = set.members().iter().map(|member| {
            let own = placements.iter().filter(|(of, _)| of == member);
            MissingCapability {
                action: self.action(*member).clone(),
                agent: self.who(*member),
                places: own.map(|(_, placement)| placement.clone()).collect(),
            }
        });
        Alternative { missing: missing.collect() }
    }

    /// Computes where the new agents of `set` have to be, for each part of the goal in `parts` that
    /// depends on it. The key of the result is the part of the goal; an entry is the number of a
    /// supposition in the set, and the place of its agent.
    fn place(
        &mut self,
        set: &SuppositionSet,
        parts: &BTreeSet<usize>,
    ) -> BTreeMap<usize, Vec<(u32, Placement)>> {
        let mut placed: BTreeMap<usize, Vec<(u32, Placement)>> = BTreeMap::new();
        for (number, group) in self.rules.groups.iter().enumerate() {
            let Some(member) = self.owner(set, group) else { continue };
            let without = self.reached(set, number, None);
            let wanting: Vec<usize> =
                parts.iter().filter(|part| !without.contains(part)).copied().collect();
            if wanting.is_empty() {
                continue;
            }
            let mut fits: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
            let tried = group.values.len().min(PLACES_MAX);
            for value in 0..tried {
                let reached = self.reached(set, number, Some(value));
                for part in wanting.iter().filter(|part| reached.contains(part)) {
                    fits.entry(*part).or_default().push(value);
                }
            }
            let supposable = &self.supposed.placements[group.placement];
            let (predicate, is_reversed) =
                (supposable.predicate.clone(), supposable.capability.is_none());
            for part in wanting {
                let fits = fits.get(&part).map_or(&[] as &[usize], Vec::as_slice);
                let possible = self.possible(set, group, tried);
                // If no single place suffices, the agent must be in several places, which are not
                // listed.
                let is_anywhere = fits.is_empty() || possible > 1 && fits.len() >= possible;
                let place =
                    if is_anywhere { RequiredPlace::Anywhere } else { self.at(group, fits) };
                let predicate = predicate.clone();
                let placement = Placement { predicate, is_reversed, place };
                placed.entry(part).or_default().push((member, placement));
            }
        }
        placed
    }

    /// Returns the number of possible places among the first `tried` places of a group. Places on
    /// new agents that are not in the set are impossible.
    fn possible(&self, set: &SuppositionSet, group: &PlaceGroup, tried: usize) -> usize {
        let is_there = |object| match self.supposed.who(object) {
            SupposedObject::Here(_) => true,
            SupposedObject::New(_) => set.members().iter().any(|member| {
                let (_, agent) = &self.rules.suppositions[*member as usize];
                agent == object
            }),
        };
        group.values[..tried].iter().filter(|value| value.iter().all(is_there)).count()
    }

    fn at(&self, group: &PlaceGroup, values: &[usize]) -> RequiredPlace {
        let who = |value: &usize| {
            group.values[*value].iter().map(|object| self.supposed.who(object)).collect()
        };
        RequiredPlace::At(values.iter().map(who).collect())
    }

    /// Returns the supposition in the set that a group of places belongs to; `None` if there is
    /// none.
    fn owner(&self, set: &SuppositionSet, group: &PlaceGroup) -> Option<u32> {
        let capability = self.supposed.placements[group.placement].capability;
        set.members().iter().copied().find(|member| {
            let (of, agent) = &self.rules.suppositions[*member as usize];
            *agent == group.agent && capability.is_none_or(|capability| capability == *of)
        })
    }

    /// Returns the parts of the goal that are reachable with the suppositions of a set. Of the
    /// places in `group`, only the place `only` is allowed; `None` allows no place.
    fn reached(&mut self, set: &SuppositionSet, group: usize, only: Option<usize>) -> Vec<usize> {
        if self.steps >= STEPS_MAX {
            self.is_complete = false;
            return Vec::new();
        }
        let allowed = |origin| match origin {
            RuleOrigin::World => true,
            RuleOrigin::Suppose(number) => set.members().contains(&number),
            RuleOrigin::Place(of, value) => of != group || only == Some(value),
        };
        self.rules.reached(allowed, &mut self.steps)
    }
}
