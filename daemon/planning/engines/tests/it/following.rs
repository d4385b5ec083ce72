//! Uses a planner as a validator, by a task in which a given plan is the only way to the goal.
//!
//! Each step of the plan becomes an action with fixed arguments that is possible only once, in the
//! order of the plan. The goal can be reached exactly if the plan is valid by the planner's
//! semantics.

use pddl::{Atom, Condition, Domain, Effect, Name, PlanStep, Problem, Span, Term};

/// Returns the texts of a domain and a problem that allow the given steps only, in their order.
pub(crate) fn task((domain, problem): &(Domain, Problem), steps: &[PlanStep]) -> (String, String) {
    let (mut domain, mut problem) = (domain.clone(), problem.clone());
    // Steps mention objects, so the domain must declare them.
    let objects = std::mem::take(&mut problem.objects);
    domain.constants.extend(objects.iter().map(|declared| declared.object.clone()));
    let schemas = std::mem::take(&mut domain.actions);
    let turns = steps.len() + 1;
    domain.predicates.extend((0..turns).map(|turn| pddl::PredicateDeclaration {
        name: name_of(turn),
        parameters: Vec::new(),
        privacy: pddl::Privacy::Public,
    }));
    for (turn, step) in steps.iter().enumerate() {
        let schema = schemas.iter().find(|schema| schema.name == step.action);
        let mut action = schema.expect("a step of the domain").clone();
        action.name = Name::new(&format!("step-{turn}"));
        let fixed = action.parameters.iter().zip(&step.arguments).map(|(parameter, object)| {
            let variable = Term::Variable(parameter.name.clone());
            Condition::Equal(variable, Term::Object(object.clone()), Span::default())
        });
        let mut all: Vec<Condition> = fixed.collect();
        all.push(Condition::Atom(at(turn)));
        all.push(action.precondition);
        action.precondition = Condition::And(all);
        action.effect =
            Effect::And(vec![action.effect, Effect::Delete(at(turn)), Effect::Add(at(turn + 1))]);
        domain.actions.push(action);
    }
    problem.init.push(pddl::InitElement::Atom(at(0)));
    problem.goal = Condition::And(vec![problem.goal, Condition::Atom(at(steps.len()))]);
    (domain.to_string(), problem.to_string())
}

fn name_of(turn: usize) -> Name {
    Name::new(&format!("turn-{turn}"))
}

fn at(turn: usize) -> Atom {
    Atom { predicate: name_of(turn), arguments: Vec::new(), span: Span::default() }
}
