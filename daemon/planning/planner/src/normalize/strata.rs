//! Stratification: an axiom may negate only predicates of lower strata.

use pddl::{Diagnostic, Domain};

use super::lifted::LiftedAxiom;

/// Assigns a stratum to every axiom. Returns an error if an axiom depends on its own negation.
pub(super) fn assign(axioms: &mut [LiftedAxiom], domain: &Domain) -> Result<(), Box<Diagnostic>> {
    let heads: Vec<usize> = axioms.iter().map(|axiom| axiom.head).collect();
    let mut dependencies = Vec::new();
    for (index, axiom) in axioms.iter().enumerate() {
        // All axioms of a predicate are of one stratum, also those whose bodies have no literals.
        let same = (0..heads.len()).filter(|other| *other != index && heads[*other] == axiom.head);
        dependencies.extend(same.map(|other| (index, other, 0)));
        axiom.body.literals(&mut |positive, atom| {
            for (other, head) in heads.iter().enumerate() {
                if *head == atom.predicate {
                    dependencies.push((index, other, usize::from(!positive)));
                }
            }
        });
    }
    // Only a cycle through a negation can give a stratum higher than the number of axioms.
    for _ in 0..=axioms.len() * axioms.len() {
        let mut changed = false;
        for &(index, other, step) in &dependencies {
            let wanted = axioms[other].stratum + step;
            if axioms[index].stratum < wanted {
                axioms[index].stratum = wanted;
                changed = true;
                if wanted > heads.len() {
                    return Err(Box::new(cyclic(domain, index)));
                }
            }
        }
        if !changed {
            return Ok(());
        }
    }
    Ok(())
}

fn cyclic(domain: &Domain, index: usize) -> Diagnostic {
    let axiom = &domain.derived[index];
    let message = format!("`{}` depends on its own negation", axiom.predicate);
    Diagnostic::error(axiom.span, message)
}
