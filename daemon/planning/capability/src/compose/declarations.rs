//! Selects the declarations of the composite. The ontology takes precedence over all agents. Equal
//! declarations count once. If two agents disagree, the declaration that is already in force takes
//! precedence.

use std::collections::{BTreeMap, BTreeSet};

use pddl::{Domain, Name, TypeExpr, Typed, Types};

use super::incumbents::DeclarationsInForce;
use super::{ConflictReport, Contribution, SharedModel};
use crate::canonical::CanonicalText;
use crate::conflict::{ModelPart, ModelPartKind};
use crate::model_summary::{Declaration, DeclaredItem, ModelAxiom};
use crate::vocabulary::{DomainVocabulary, Signature};

/// The selected declarations of the agents, and the vocabulary of the domain that results from
/// them.
#[derive(Default)]
pub(super) struct SelectedDeclarations<'a> {
    pub(super) kept: Vec<SelectedDeclaration<'a>>,
    pub(super) axioms: Vec<&'a ModelAxiom>,
    pub(super) vocabulary: DomainVocabulary,
}

/// A selected declaration, and properties of all the agents that make this declaration.
#[derive(Clone, Copy)]
pub(super) struct SelectedDeclaration<'a> {
    /// The declaration as written by the first declaring agent in the order of names.
    pub(super) declaration: &'a Declaration,
    by: Contribution<'a>,
    /// Whether all declaring agents declare the part private.
    pub(super) private: bool,
    /// Whether the whole model of at least one declaring agent is used, so that the axioms are
    /// known.
    trusted: bool,
}

/// A declaration of a part, after the contribution of the agent that declares it.
type ContributedDeclaration<'a> = (Contribution<'a>, &'a Declaration);

/// Signature of a declaration, and its axioms, as canonical texts. Two declarations of a part are
/// equal if both are equal.
pub(super) type DeclarationVariant = (CanonicalText, Vec<CanonicalText>);

pub(super) fn select_declarations<'a>(
    shared: &'a SharedModel,
    parties: &[Contribution<'a>],
    incumbents: &mut DeclarationsInForce,
    report: &mut ConflictReport<'a>,
) -> SelectedDeclarations<'a> {
    let (words, mut kept, mut variants) = (words_of(parties), Vec::new(), Vec::new());
    // This is a merge join in the order of subjects, because both sequences are long.
    let mut stood = std::mem::take(incumbents).into_iter().peekable();
    for words in words.chunk_by(|(_, one), (_, other)| one.subject == other.subject) {
        let subject = &words[0].1.subject;
        if let Some(declared) = shared.declared(subject) {
            yield_to_ontology(declared, words, report);
            continue;
        }
        while stood.next_if(|(former, _)| former < subject).is_some() {}
        let stood = stood.next_if(|(former, _)| former == subject);
        let winner = choose(subject, words, stood.as_ref().map(|(_, stood)| stood), report);
        let stands = match stood {
            Some((subject, stood)) if is_variant(winner.declaration, &stood) => (subject, stood),
            _ => (subject.clone(), variant_of(winner.declaration)),
        };
        variants.push(stands);
        kept.push(winner);
    }
    *incumbents = variants.into_iter().collect();
    stand(shared, parties, kept, report)
}

/// Returns all declarations of agents that are visible in this composition, sorted by declared part
/// and then by agent.
fn words_of<'a>(parties: &[Contribution<'a>]) -> Vec<ContributedDeclaration<'a>> {
    let known = |party: &Contribution<'a>| {
        let party = *party;
        let known = party.manifest.declarations.iter();
        known.filter(move |word| party.trusted || !word.private).map(move |word| (party, word))
    };
    let mut words: Vec<ContributedDeclaration<'a>> = parties.iter().flat_map(known).collect();
    words.sort_by(|(_, one), (_, other)| one.subject.cmp(&other.subject));
    words
}

pub(super) fn variant_of(declaration: &Declaration) -> DeclarationVariant {
    let axioms = declaration.axioms.iter().map(|axiom| axiom.key.clone()).collect();
    (declaration.signature.clone(), axioms)
}

fn is_variant(declaration: &Declaration, (signature, axioms): &DeclarationVariant) -> bool {
    let keys = declaration.axioms.iter().map(|axiom| &axiom.key);
    declaration.signature == *signature && keys.eq(axioms)
}

fn yield_to_ontology(
    declared: &Declaration,
    words: &[ContributedDeclaration<'_>],
    report: &mut ConflictReport<'_>,
) {
    for (party, word) in words.iter().filter(|(_, word)| !word.repeats(declared)) {
        let owner = if word.subject.kind == ModelPartKind::Object { "map" } else { "ontology" };
        let detail = format!(
            "the {owner} declares {}, which is used; {} is left out",
            shown(declared),
            shown(word)
        );
        report.leave_out(party.agent, word.subject.clone(), detail);
    }
}

/// Chooses the declaration in force for one part. Reports a conflict for each agent with a
/// different declaration.
fn choose<'a>(
    subject: &'a ModelPart,
    words: &[ContributedDeclaration<'a>],
    incumbent: Option<&DeclarationVariant>,
    report: &mut ConflictReport<'a>,
) -> SelectedDeclaration<'a> {
    if let [(by, declaration)] = *words {
        return SelectedDeclaration {
            declaration,
            by,
            private: declaration.private,
            trusted: by.trusted,
        };
    }
    let stood = |word: &&ContributedDeclaration<'a>| {
        incumbent.is_some_and(|stood| is_variant(word.1, stood))
    };
    let first = words.iter().min_by_key(|(party, _)| party.arrival);
    let chosen = words.iter().find(stood).or(first);
    let (_, winner) = chosen.expect("invariant: each subject is declared");
    let (agreeing, others): (Vec<_>, Vec<_>) =
        words.iter().partition(|(_, word)| word.agrees(winner));
    let keeper = agreeing.iter().min_by_key(|(party, _)| party.arrival);
    let (keeper, _) = keeper.expect("invariant: the winner agrees with itself");
    for (party, word) in others {
        let detail = format!(
            "`{}` declares {}, which is used; {} of `{}` is left out",
            keeper.agent,
            shown(winner),
            shown(word),
            party.agent
        );
        report.lose(keeper.agent, party.agent, subject, detail);
    }
    let (by, declaration) = agreeing[0];
    SelectedDeclaration {
        declaration,
        by,
        private: agreeing.iter().all(|(_, word)| word.private),
        trusted: agreeing.iter().any(|(party, _)| party.trusted),
    }
}

fn shown(declaration: &Declaration) -> String {
    let typed = |typed: &Typed| format!("`{} - {}`", typed.name, typed.ty);
    match &declaration.item {
        DeclaredItem::Type(declared) => typed(declared),
        DeclaredItem::Object(declared) => typed(&declared.object),
        DeclaredItem::Predicate(declared) if declaration.axioms.is_empty() => {
            format!("`{declared}`")
        }
        DeclaredItem::Predicate(declared) => format!("`{declared}` with its axioms"),
        DeclaredItem::Function(declared) => format!("`{declared}`"),
    }
}

/// Leaves out declarations that use undeclared types or form cycles. Computes the vocabulary and
/// the axioms of the remaining declarations.
fn stand<'a>(
    shared: &'a SharedModel,
    parties: &[Contribution<'a>],
    kept: Vec<SelectedDeclaration<'a>>,
    report: &mut ConflictReport<'a>,
) -> SelectedDeclarations<'a> {
    let kept = without_circles(&shared.ontology, kept, report);
    let types = kept.iter().filter_map(|kept| match &kept.declaration.item {
        DeclaredItem::Type(typed) => Some(typed),
        _ => None,
    });
    let types = Types::new(shared.ontology.types.iter().chain(types));
    let (kept, unfounded): (Vec<_>, Vec<_>) =
        kept.into_iter().partition(|kept| unknown_type(&types, kept.declaration).is_none());
    for SelectedDeclaration { declaration, by, .. } in unfounded {
        if let Some(name) = unknown_type(&types, declaration) {
            let detail = format!("it uses the type `{name}`, which is not declared");
            report.leave_out(by.agent, declaration.subject.clone(), detail);
        }
    }
    let vocabulary = vocabulary_of(shared, &kept, types);
    let axioms = axioms_of(parties, &kept, shared, &vocabulary, report);
    SelectedDeclarations { kept, axioms, vocabulary }
}

fn unknown_type<'a>(types: &Types, declaration: &'a Declaration) -> Option<&'a Name> {
    let used = declaration.item.types().into_iter().flat_map(|ty| &ty.alternatives);
    { used }.find(|name| !types.contains(name.as_str()))
}

/// Leaves out types that are their own supertypes, directly or through other types.
fn without_circles<'a>(
    ontology: &Domain,
    kept: Vec<SelectedDeclaration<'a>>,
    report: &mut ConflictReport<'a>,
) -> Vec<SelectedDeclaration<'a>> {
    let mut parents: BTreeMap<&Name, &TypeExpr> =
        ontology.types.iter().map(|typed| (&typed.name, &typed.ty)).collect();
    for kept in &kept {
        if let DeclaredItem::Type(typed) = &kept.declaration.item {
            parents.insert(&typed.name, &typed.ty);
        }
    }
    let (circular, kept): (Vec<_>, Vec<_>) = kept.iter().partition(|kept| {
        kept.declaration.subject.kind == ModelPartKind::Type
            && reaches_itself(&kept.declaration.subject.name, &parents)
    });
    for SelectedDeclaration { declaration, by, .. } in circular {
        let detail = format!("{} makes the type its own supertype", shown(declaration));
        report.leave_out(by.agent, declaration.subject.clone(), detail);
    }
    kept
}

fn reaches_itself(name: &Name, parents: &BTreeMap<&Name, &TypeExpr>) -> bool {
    let above = |name: &Name| parents.get(name).into_iter().flat_map(|ty| &ty.alternatives);
    let mut seen = BTreeSet::new();
    let mut open: Vec<&Name> = above(name).collect();
    while let Some(next) = open.pop() {
        if next == name {
            return true;
        }
        if seen.insert(next) {
            open.extend(above(next));
        }
    }
    false
}

fn vocabulary_of(
    shared: &SharedModel,
    kept: &[SelectedDeclaration<'_>],
    types: Types,
) -> DomainVocabulary {
    let mut objects = Vec::new();
    let mut vocabulary = DomainVocabulary { types, ..DomainVocabulary::default() };
    let ours = shared.manifest.declarations.iter().map(|declaration| (declaration, true));
    let theirs = kept.iter().map(|kept| (kept.declaration, kept.trusted));
    for (declaration, with_axioms) in ours.chain(theirs) {
        let name = declaration.subject.name.clone();
        let signature = |parameters: &[Typed]| Signature {
            parameters: parameters.iter().map(|parameter| parameter.ty.clone()).collect(),
            derived: with_axioms && !declaration.axioms.is_empty(),
        };
        match &declaration.item {
            DeclaredItem::Type(_) => (),
            DeclaredItem::Object(declared) => {
                objects.push((name, declared.object.ty.clone()));
            }
            DeclaredItem::Predicate(declared) => {
                vocabulary.predicates.insert(name, signature(&declared.parameters));
            }
            DeclaredItem::Function(declared) => {
                vocabulary.functions.insert(name, signature(&declared.parameters));
            }
        }
    }
    // The map is built in one step: with an object per device, one insertion after the other is
    // slow.
    vocabulary.objects = objects.into_iter().collect();
    vocabulary
}

/// Returns the valid axioms of agents. An axiom is valid if it derives a predicate that its agent
/// declares and uses declared symbols only.
fn axioms_of<'a>(
    parties: &[Contribution<'a>],
    kept: &[SelectedDeclaration<'a>],
    shared: &SharedModel,
    vocabulary: &DomainVocabulary,
    report: &mut ConflictReport<'a>,
) -> Vec<&'a ModelAxiom> {
    let known =
        |key: &CanonicalText| shared.manifest.declarations.iter().any(|d| has_axiom(d, key));
    for party in parties.iter().filter(|party| party.trusted) {
        for axiom in party.manifest.loose_axioms.iter().filter(|axiom| !known(&axiom.key)) {
            let subject = ModelPart::new(ModelPartKind::Axiom, &axiom.tree.predicate);
            let detail = "the model does not declare the predicate, and only a model that \
                          declares it may derive it";
            report.leave_out(party.agent, subject, detail.to_owned());
        }
    }
    let mut standing = Vec::new();
    for SelectedDeclaration { declaration, by, trusted, .. } in kept {
        for axiom in declaration.axioms.iter().filter(|_| *trusted) {
            match vocabulary.misfit(&axiom.uses) {
                None => standing.push(axiom),
                Some(detail) => {
                    let subject = ModelPart::new(ModelPartKind::Axiom, &axiom.tree.predicate);
                    report.leave_out(by.agent, subject, detail);
                }
            }
        }
    }
    standing
}

fn has_axiom(declaration: &Declaration, key: &CanonicalText) -> bool {
    declaration.axioms.iter().any(|axiom| axiom.key == *key)
}
