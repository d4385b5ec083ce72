//! What does not change while a plan runs: names, types, objects, and the order of the axioms.
//!
//! Written for the validator alone; the planner proper has its own tables, so that one mistake
//! cannot be made twice in the same way.

use std::collections::{BTreeMap, HashMap};

use pddl::{Condition, Diagnostic, Domain, Metric, Name, Problem, TypeExpr, Typed, Types};

/// The unchanging side of a [`super::World`].
#[derive(Debug)]
pub(crate) struct Model {
    pub(crate) domain: Domain,
    pub(crate) metric: Option<Metric>,
    /// Every object once, in the order of the texts, with its type.
    objects: BTreeMap<Name, TypeExpr>,
    /// All objects of a type, its subtypes' included, in the order of the texts.
    members: BTreeMap<Name, Vec<Name>>,
    everything: Vec<Name>,
    types: Types,
    /// The types that accept objects of a type; looked up only.
    accepting: HashMap<TypeExpr, Vec<Name>>,
    /// Indices into `domain.derived`, by stratum.
    pub(crate) strata: Vec<Vec<usize>>,
}

/// Truth, for the bookkeeping of negation: `true` is positive.
type Polarity = bool;

// === impl Model ===

impl Model {
    pub(crate) fn new(domain: &Domain, problem: &Problem) -> Result<Model, Vec<Diagnostic>> {
        let mut model = Model {
            domain: domain.clone(),
            metric: problem.metric.clone(),
            objects: BTreeMap::new(),
            members: BTreeMap::new(),
            everything: Vec::new(),
            types: Types::of(domain),
            accepting: HashMap::new(),
            strata: strata(domain)?,
        };
        let declared = problem.objects.iter().map(|declaration| &declaration.object);
        for object in domain.constants.iter().chain(declared) {
            model.add_object(object);
        }
        Ok(model)
    }

    /// Whether the object exists.
    pub(crate) fn knows(&self, object: &Name) -> bool {
        self.objects.contains_key(object)
    }

    /// All objects of a type, each once.
    pub(crate) fn members(&self, ty: &TypeExpr) -> Vec<Name> {
        match ty.alternatives.as_slice() {
            _ if ty.is_object() => self.everything.clone(),
            [one] => self.members.get(one).cloned().unwrap_or_default(),
            _ => self.everything.iter().filter(|object| self.is_a(object, ty)).cloned().collect(),
        }
    }

    /// Whether the object belongs to the type.
    pub(crate) fn is_a(&self, object: &Name, ty: &TypeExpr) -> bool {
        self.objects.get(object).is_some_and(|own| self.types.accepts(ty, own))
    }

    fn add_object(&mut self, object: &Typed) {
        if self.objects.insert(object.name.clone(), object.ty.clone()).is_some() {
            return;
        }
        self.everything.push(object.name.clone());
        let accepting = self.accepting.entry(object.ty.clone()).or_insert_with(|| {
            let accepts = |ty: &&Name| self.types.accepts(&TypeExpr::of((*ty).clone()), &object.ty);
            self.types.iter().filter(accepts).cloned().collect()
        });
        for ty in accepting {
            self.members.entry(ty.clone()).or_default().push(object.name.clone());
        }
    }
}

/// Sorts the axioms so that each only negates what an earlier stratum has settled.
fn strata(domain: &Domain) -> Result<Vec<Vec<usize>>, Vec<Diagnostic>> {
    let mut level: BTreeMap<&Name, usize> =
        domain.derived.iter().map(|axiom| (&axiom.predicate, 0)).collect();
    let limit = level.len();
    let mut uses = Vec::new();
    for axiom in &domain.derived {
        collect_uses(&axiom.condition, true, &mut |used, polarity| {
            uses.push((axiom, used.clone(), polarity));
        });
    }
    let mut changed = true;
    while changed {
        changed = false;
        for (axiom, used, polarity) in &uses {
            let Some(&below) = level.get(used) else { continue };
            let wanted = below + usize::from(!polarity);
            if wanted >= limit.max(1) && !polarity {
                let message = format!("`{}` depends on its own negation", axiom.predicate);
                return Err(vec![Diagnostic::error(axiom.span, message)]);
            }
            if level.get(&axiom.predicate).is_some_and(|own| *own < wanted) {
                level.insert(&axiom.predicate, wanted);
                changed = true;
            }
        }
    }
    let mut strata = vec![Vec::new(); limit];
    for (index, axiom) in domain.derived.iter().enumerate() {
        strata[level[&axiom.predicate]].push(index);
    }
    strata.retain(|stratum| !stratum.is_empty());
    Ok(strata)
}

fn collect_uses(condition: &Condition, polarity: Polarity, found: &mut dyn FnMut(&Name, Polarity)) {
    match condition {
        Condition::Atom(atom) => found(&atom.predicate, polarity),
        Condition::Equal(..) | Condition::Compare(_) => (),
        Condition::Not(inner) => collect_uses(inner, !polarity, found),
        Condition::And(parts) | Condition::Or(parts) => {
            parts.iter().for_each(|part| collect_uses(part, polarity, found));
        }
        Condition::Imply(left, right) => {
            collect_uses(left, !polarity, found);
            collect_uses(right, polarity, found);
        }
        Condition::Exists(_, inner) | Condition::Forall(_, inner) => {
            collect_uses(inner, polarity, found);
        }
    }
}
