//! What does not change while a plan runs: names, types, objects, and the order of the axioms.
//!
//! Written for the validator alone; the planner proper has its own tables, so that one mistake
//! cannot be made twice in the same way.

use std::collections::BTreeMap;

use pddl::{Condition, Diagnostic, Domain, Metric, Name, Problem, TypeExpr, Typed};

/// The unchanging side of a [`super::World`].
#[derive(Debug)]
pub(super) struct Model {
    pub(super) domain: Domain,
    pub(super) metric: Option<Metric>,
    /// Every object once, in the order of the texts, with its type.
    objects: BTreeMap<Name, TypeExpr>,
    /// All objects of a type, its subtypes' included, in the order of the texts.
    members: BTreeMap<Name, Vec<Name>>,
    everything: Vec<Name>,
    ancestors: BTreeMap<Name, Vec<Name>>,
    /// Indices into `domain.derived`, by stratum.
    pub(super) strata: Vec<Vec<usize>>,
}

/// Truth, for the bookkeeping of negation: `true` is positive.
type Polarity = bool;

// === impl Model ===

impl Model {
    pub(super) fn new(domain: &Domain, problem: &Problem) -> Result<Model, Vec<Diagnostic>> {
        let mut model = Model {
            domain: domain.clone(),
            metric: problem.metric.clone(),
            objects: BTreeMap::new(),
            members: BTreeMap::new(),
            everything: Vec::new(),
            ancestors: ancestors(&domain.types),
            strata: strata(domain)?,
        };
        let declared = problem.objects.iter().map(|declaration| &declaration.object);
        for object in domain.constants.iter().chain(declared) {
            model.add_object(object);
        }
        Ok(model)
    }

    /// Whether the object exists.
    pub(super) fn knows(&self, object: &Name) -> bool {
        self.objects.contains_key(object)
    }

    /// All objects of a type, each once.
    pub(super) fn members(&self, ty: &TypeExpr) -> Vec<Name> {
        match ty.alternatives.as_slice() {
            _ if ty.is_object() => self.everything.clone(),
            [one] => self.members.get(one).cloned().unwrap_or_default(),
            _ => self.everything.iter().filter(|object| self.is_a(object, ty)).cloned().collect(),
        }
    }

    /// Whether the object belongs to the type.
    pub(super) fn is_a(&self, object: &Name, ty: &TypeExpr) -> bool {
        let Some(own) = self.objects.get(object) else { return false };
        ty.is_object()
            || own.alternatives.iter().any(|own| {
                let above = self.ancestors.get(own).map_or(&[][..], Vec::as_slice);
                ty.alternatives.iter().any(|wanted| wanted == own || above.contains(wanted))
            })
    }

    fn add_object(&mut self, object: &Typed) {
        if self.objects.insert(object.name.clone(), object.ty.clone()).is_some() {
            return;
        }
        self.everything.push(object.name.clone());
        let mut types: Vec<&Name> = Vec::new();
        for own in &object.ty.alternatives {
            types.push(own);
            types.extend(self.ancestors.get(own).into_iter().flatten());
        }
        types.sort();
        types.dedup();
        for ty in types {
            self.members.entry(ty.clone()).or_default().push(object.name.clone());
        }
    }
}

/// All supertypes of every type, itself left out.
fn ancestors(types: &[Typed]) -> BTreeMap<Name, Vec<Name>> {
    let mut above = BTreeMap::<Name, Vec<Name>>::new();
    for ty in types {
        let parents = above.entry(ty.name.clone()).or_default();
        parents.extend(ty.ty.alternatives.iter().cloned());
    }
    let names: Vec<Name> = above.keys().cloned().collect();
    for name in names {
        let mut reached = above.get(&name).cloned().unwrap_or_default();
        let mut next = 0;
        while let Some(parent) = reached.get(next).cloned() {
            for grandparent in above.get(&parent).into_iter().flatten() {
                if !reached.contains(grandparent) {
                    reached.push(grandparent.clone());
                }
            }
            next += 1;
        }
        above.insert(name, reached);
    }
    above
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
