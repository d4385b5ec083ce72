//! Opaque names: what is private is named to others by its agent and a number, in the order of the
//! declarations.

use std::collections::{BTreeMap, BTreeSet};

use pddl::Name;
use pddl::factored::AgentFiles;

use crate::private_symbols::{PrivateSymbol, PrivateSymbols};
use crate::terms::UsedTerms;

/// Separates the name of a member from the rest of a name that only this member uses.
pub(crate) const OWN: &str = "--";

/// Checks that a member can have this name. Otherwise an opaque name would not show its member.
///
/// # Errors
///
/// Returns the reason, as text for a person.
pub(crate) fn check_member_name(member: &str) -> Result<(), String> {
    match member.contains(OWN) || member.ends_with('-') {
        true => Err(format!("the name `{member}` of a member contains `{OWN}`, or ends with `-`")),
        false => Ok(()),
    }
}

/// Returns the words of a text in PDDL that have the form of an opaque name, wherever they stand.
pub(crate) fn opaque_words(text: &str) -> impl Iterator<Item = &str> {
    let is_part = |letter: char| letter.is_alphanumeric() || letter == '-' || letter == '_';
    text.split(move |letter| !is_part(letter)).filter(|word| word.contains(OWN))
}

/// How a projection names its actions.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum ActionNaming {
    /// Each name belongs to one agent, and the agent is a parameter like the others: for tasks that
    /// are merged.
    OfMember,
    /// An action with a public effect keeps its name, and each action its agent: for action models,
    /// which are composed by the Domain Maintainer.
    OfModel,
}

/// The opaque names of one agent, the same in each of its projections.
#[derive(Clone)]
pub(crate) struct OpaqueNames {
    agent: String,
    naming: ActionNaming,
    objects: BTreeMap<Name, Name>,
    functions: BTreeMap<Name, Name>,
    /// In the order of the declarations.
    predicates: Vec<(PrivateSymbol, Name)>,
    actions: BTreeMap<Name, Name>,
    variables: BTreeMap<Name, Name>,
}

// === impl OpaqueNames ===

impl OpaqueNames {
    /// Returns the opaque names of a task. What has a name in `former`, names of the same agent, keeps
    /// it.
    pub(crate) fn new(
        task: &AgentFiles,
        symbols: &PrivateSymbols,
        predicates: &BTreeSet<PrivateSymbol>,
        (naming, former): (ActionNaming, Option<&OpaqueNames>),
    ) -> OpaqueNames {
        let AgentFiles { agent, domain, problem } = task;
        let place = |name: &Name| domain.predicates.iter().position(|it| it.name == *name);
        let mut in_order: Vec<PrivateSymbol> = predicates.iter().cloned().collect();
        in_order.sort_by_key(|symbol| (place(&symbol.predicate), symbol.positions.clone()));
        let functions = domain.functions.iter().map(|it| it.name.clone());
        let functions = functions.filter(|name| symbols.is_private_function(name));
        let objects = symbols.private_objects().iter().map(|object| object.name.clone());
        let mut variables = Vec::new();
        for action in &domain.actions {
            variables.extend(action.all_parameters().map(|typed| typed.name.clone()));
            let mut used = UsedTerms::default();
            used.condition(&action.precondition);
            used.effect(&action.effect);
            variables.extend(used.declared.into_iter().map(|typed| typed.name));
        }
        let mut goal = UsedTerms::default();
        goal.condition(&problem.goal);
        variables.extend(goal.declared.into_iter().map(|typed| typed.name));
        let mut numbers = BTreeMap::new();
        for variable in variables {
            let number = numbers.len();
            numbers.entry(variable).or_insert_with(|| Name::new(&format!("x{number}")));
        }
        OpaqueNames {
            agent: agent.clone(),
            naming,
            objects: numbered((agent, "o"), objects, known(former.map(|it| &it.objects))),
            functions: numbered((agent, "f"), functions, known(former.map(|it| &it.functions))),
            predicates: numbered(
                (agent, "p"),
                in_order.into_iter(),
                former.map(|it| it.predicates.clone()).unwrap_or_default(),
            ),
            actions: numbered(
                (agent, "a"),
                domain.actions.iter().map(|action| action.name.clone()),
                known(former.map(|it| &it.actions)),
            ),
            variables: numbers,
        }
    }

    pub(crate) fn object(&self, name: &Name) -> Name {
        self.objects.get(name).unwrap_or(name).clone()
    }

    /// Returns the private object with an opaque name.
    pub(crate) fn object_of(&self, opaque: &Name) -> Option<&Name> {
        self.objects.iter().find(|(_, name)| *name == opaque).map(|(name, _)| name)
    }

    pub(crate) fn function(&self, name: &Name) -> Name {
        self.functions.get(name).unwrap_or(name).clone()
    }

    /// Returns the private symbols with their names, in the order of the declarations.
    pub(crate) fn predicates(&self) -> impl Iterator<Item = &(PrivateSymbol, Name)> {
        self.predicates.iter()
    }

    pub(crate) fn predicate(&self, symbol: &PrivateSymbol) -> Name {
        let known = self.predicates.iter().find(|(known, _)| known == symbol);
        known.map_or(&symbol.predicate, |(_, name)| name).clone()
    }

    pub(crate) fn variable(&self, name: &Name) -> Name {
        self.variables.get(name).unwrap_or(name).clone()
    }

    /// Returns the name of an action in the projection. It is opaque for an action that changes
    /// nothing public.
    pub(crate) fn action(&self, name: &Name, is_public: bool) -> Name {
        let agent = &self.agent;
        match (is_public, self.naming) {
            (true, ActionNaming::OfMember) => Name::new(&format!("{agent}{OWN}do-{name}")),
            (true, ActionNaming::OfModel) => name.clone(),
            (false, _) => self.actions.get(name).unwrap_or(name).clone(),
        }
    }

    /// Whether each action of the projection keeps its agent.
    pub(crate) fn keep_agents(&self) -> bool {
        self.naming == ActionNaming::OfModel
    }

    /// Whether a name is an opaque name of this agent.
    pub(crate) fn is_opaque(&self, name: &Name) -> bool {
        let rest = name.as_str().strip_prefix(self.agent.as_str());
        rest.is_some_and(|rest| rest.starts_with(OWN))
    }
}

/// Returns each thing with its opaque name: that of `former`, or the next number.
fn numbered<T: PartialEq, C: FromIterator<(T, Name)>>(
    (agent, kind): (&str, &str),
    things: impl Iterator<Item = T>,
    mut former: Vec<(T, Name)>,
) -> C {
    for thing in things {
        if !former.iter().any(|(known, _)| *known == thing) {
            let name = Name::new(&format!("{agent}{OWN}{kind}{}", former.len()));
            former.push((thing, name));
        }
    }
    former.into_iter().collect()
}

/// Returns names in the order of their numbers.
fn known(names: Option<&BTreeMap<Name, Name>>) -> Vec<(Name, Name)> {
    let mut names: Vec<(Name, Name)> =
        names.into_iter().flatten().map(|(own, name)| (own.clone(), name.clone())).collect();
    // Of names that differ in their numbers only, the shorter one has the smaller number.
    names.sort_by(|(_, left), (_, right)| {
        (left.as_str().len(), left.as_str()).cmp(&(right.as_str().len(), right.as_str()))
    });
    names
}
