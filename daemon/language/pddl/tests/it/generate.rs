//! Strategies that generate trees with all elements of the language.

use std::sync::Arc;

use pddl::*;
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

/// Generates names with letters of any case. No name is a PDDL keyword, because a keyword is not
/// allowed as a name everywhere.
fn name() -> impl Strategy<Value = Name> {
    let word = prop_oneof!["[a-c]", "[A-Za-zäß][a-z0-9_-]{0,6}x"];
    word.prop_map(|word| Name::new(&word))
}

fn number() -> impl Strategy<Value = Number> {
    let value = prop_oneof![(-9..9).prop_map(f64::from), any::<f64>()];
    value.prop_filter("numbers are finite", |value| value.is_finite()).prop_map(Number)
}

fn type_expr() -> impl Strategy<Value = TypeExpr> {
    let object = Just(vec![Name::new("object")]);
    prop_oneof![Just(Vec::new()), object, vec(name(), 1..3)]
        .prop_map(|alternatives| TypeExpr { alternatives })
}

fn typed() -> impl Strategy<Value = Typed> {
    (name(), type_expr()).prop_map(|(name, ty)| Typed { name, ty })
}

fn typed_list() -> impl Strategy<Value = Vec<Typed>> {
    vec(typed(), 0..4)
}

fn object() -> impl Strategy<Value = Term> {
    name().prop_map(Term::Object)
}

fn term() -> impl Strategy<Value = Term> {
    prop_oneof![name().prop_map(Term::Variable), object()]
}

fn atom(term: impl Strategy<Value = Term>) -> impl Strategy<Value = Atom> {
    let span = Span::default();
    let predicate = prop_oneof![name(), Just(Name::new("at"))];
    (predicate, vec(term, 0..3)).prop_map(move |(predicate, arguments)| Atom {
        predicate,
        arguments,
        span,
    })
}

fn fluent(term: impl Strategy<Value = Term>) -> impl Strategy<Value = FluentTerm> {
    let span = Span::default();
    (name(), vec(term, 0..3)).prop_map(move |(function, arguments)| FluentTerm {
        function,
        arguments,
        span,
    })
}

/// Generates expressions with the special terms in `special`, which are allowed in some places
/// only.
fn expression(special: Vec<Expression>) -> BoxedStrategy<Expression> {
    let number = number().prop_map(Expression::Number);
    let fluent = fluent(term()).prop_map(Expression::Fluent);
    let leaf = match special.is_empty() {
        true => prop_oneof![number, fluent].boxed(),
        false => prop_oneof![number, fluent, proptest::sample::select(special)].boxed(),
    };
    leaf.prop_recursive(3, 8, 3, |inner| {
        let pair = || vec(inner.clone(), 2);
        let several = || vec(inner.clone(), 2..4);
        prop_oneof![
            inner.clone().prop_map(|inner| Expression::Negate(Box::new(inner))),
            several().prop_map(|operands| Expression::Apply(Operator::Add, operands)),
            several().prop_map(|operands| Expression::Apply(Operator::Multiply, operands)),
            pair().prop_map(|operands| Expression::Apply(Operator::Subtract, operands)),
            pair().prop_map(|operands| Expression::Apply(Operator::Divide, operands)),
        ]
    })
    .boxed()
}

fn plain_expression() -> BoxedStrategy<Expression> {
    expression(Vec::new())
}

fn durative_expression() -> BoxedStrategy<Expression> {
    let span = Span::default();
    expression(vec![Expression::Duration(span), Expression::ContinuousTime(span)])
}

fn comparison() -> impl Strategy<Value = Comparison> {
    use Comparison::*;
    proptest::sample::select(vec![Less, LessOrEqual, Equal, GreaterOrEqual, Greater])
}

pub(crate) fn condition(expression: BoxedStrategy<Expression>) -> BoxedStrategy<Condition> {
    let span = Span::default();
    let compare = (comparison(), expression.clone(), expression).prop_map(
        move |(comparison, left, right)| {
            Condition::Compare(Box::new(Compare { comparison, left, right, span }))
        },
    );
    let equal = (term(), term()).prop_map(move |(l, r)| Condition::Equal(l, r, span));
    let leaf = prop_oneof![atom(term()).prop_map(Condition::Atom), equal, compare];
    leaf.prop_recursive(4, 16, 3, |inner| {
        let boxed = || inner.clone().prop_map(Box::new);
        let several = || vec(inner.clone(), 0..3);
        prop_oneof![
            boxed().prop_map(Condition::Not),
            several().prop_map(Condition::And),
            several().prop_map(Condition::Or),
            (boxed(), boxed()).prop_map(|(left, right)| Condition::Imply(left, right)),
            (typed_list(), boxed()).prop_map(|(vars, inner)| Condition::Exists(vars, inner)),
            (typed_list(), boxed()).prop_map(|(vars, inner)| Condition::Forall(vars, inner)),
        ]
    })
    .boxed()
}

fn assign(
    assignments: Vec<Assignment>,
    expression: BoxedStrategy<Expression>,
) -> impl Strategy<Value = Box<Assign>> {
    let span = Span::default();
    (proptest::sample::select(assignments), fluent(term()), expression).prop_map(
        move |(assignment, fluent, value)| Box::new(Assign { assignment, fluent, value, span }),
    )
}

fn effect(expression: BoxedStrategy<Expression>) -> BoxedStrategy<Effect> {
    use Assignment::*;
    let all = vec![Assign, Increase, Decrease, ScaleUp, ScaleDown];
    let condition = condition(expression.clone());
    let leaf = prop_oneof![
        atom(term()).prop_map(Effect::Add),
        atom(term()).prop_map(Effect::Delete),
        assign(all, expression).prop_map(Effect::Assign),
    ];
    leaf.prop_recursive(3, 12, 3, move |inner| {
        let boxed = || inner.clone().prop_map(Box::new);
        let condition = condition.clone().prop_map(Box::new);
        prop_oneof![
            vec(inner.clone(), 0..3).prop_map(Effect::And),
            (typed_list(), boxed()).prop_map(|(vars, inner)| Effect::Forall(vars, inner)),
            (condition, boxed()).prop_map(|(condition, inner)| Effect::When(condition, inner)),
        ]
    })
    .boxed()
}

fn action() -> impl Strategy<Value = ActionSchema> {
    let span = Span::default();
    let parts = (
        name(),
        option::of((typed(), typed_list())),
        typed_list(),
        condition(plain_expression()),
        effect(plain_expression()),
        vec(atom(term()), 0..3),
    );
    parts.prop_map(move |(name, agents, parameters, precondition, effect, observe)| {
        let (agent, partners) = agents.unzip();
        let partners = partners.unwrap_or_default();
        ActionSchema { name, agent, partners, parameters, precondition, effect, observe, span }
    })
}

fn derived() -> impl Strategy<Value = Derived> {
    let span = Span::default();
    (name(), typed_list(), condition(plain_expression())).prop_map(
        move |(predicate, parameters, condition)| Derived {
            predicate,
            parameters,
            condition,
            span,
        },
    )
}

fn duration() -> impl Strategy<Value = DurationConstraint> {
    use Comparison::*;
    let when = option::of(proptest::sample::select(vec![TimeSpecifier::Start, TimeSpecifier::End]));
    let comparison = proptest::sample::select(vec![Equal, LessOrEqual, GreaterOrEqual]);
    (when, comparison, durative_expression())
        .prop_map(|(when, comparison, value)| DurationConstraint { when, comparison, value })
}

fn timed_condition() -> impl Strategy<Value = TimedCondition> {
    use TimeSpecifier::*;
    let when = proptest::sample::select(vec![Start, End, OverAll]);
    (typed_list(), when, condition(durative_expression()))
        .prop_map(|(forall, when, condition)| TimedCondition { forall, when, condition })
}

fn timed_effect() -> BoxedStrategy<TimedEffect> {
    let when = proptest::sample::select(vec![TimeSpecifier::Start, TimeSpecifier::End]);
    let changes = vec![Assignment::Increase, Assignment::Decrease];
    let leaf = prop_oneof![
        (when, effect(durative_expression()))
            .prop_map(|(when, effect)| TimedEffect::At(when, effect)),
        assign(changes, durative_expression()).prop_map(TimedEffect::Continuous),
    ];
    leaf.prop_recursive(2, 6, 2, |inner| {
        let boxed = || inner.clone().prop_map(Box::new);
        let conditions = vec(timed_condition(), 0..2);
        prop_oneof![
            vec(inner.clone(), 0..3).prop_map(TimedEffect::And),
            (typed_list(), boxed()).prop_map(|(vars, inner)| TimedEffect::Forall(vars, inner)),
            (conditions, boxed()).prop_map(|(conditions, it)| TimedEffect::When(conditions, it)),
        ]
    })
    .boxed()
}

fn durative_action() -> impl Strategy<Value = DurativeAction> {
    let span = Span::default();
    let parts = (
        name(),
        option::of(typed()),
        typed_list(),
        vec(duration(), 0..3),
        vec(timed_condition(), 0..3),
        timed_effect(),
    );
    parts.prop_map(move |(name, agent, parameters, duration, conditions, effects)| DurativeAction {
        name,
        agent,
        parameters,
        duration,
        conditions,
        effects,
        span,
    })
}

fn privacy(owner: impl Strategy<Value = Typed>) -> impl Strategy<Value = Privacy> {
    prop_oneof![2 => Just(Privacy::Public), 1 => option::of(owner).prop_map(Privacy::Private)]
}

fn predicate() -> impl Strategy<Value = PredicateDeclaration> {
    (name(), typed_list(), privacy(typed()))
        .prop_map(|(name, parameters, privacy)| PredicateDeclaration { name, parameters, privacy })
}

fn function() -> impl Strategy<Value = FunctionDeclaration> {
    (name(), typed_list(), privacy(typed()))
        .prop_map(|(name, parameters, privacy)| FunctionDeclaration { name, parameters, privacy })
}

/// Generates objects. The owner of an object has no type, because only its name is printed.
fn objects() -> impl Strategy<Value = Vec<ObjectDeclaration>> {
    let owner = name().prop_map(|name| Typed { name, ty: TypeExpr::default() });
    let object = (typed(), privacy(owner));
    vec(object.prop_map(|(object, privacy)| ObjectDeclaration { object, privacy }), 0..4)
}

fn init_element() -> impl Strategy<Value = InitElement> {
    let leaf = prop_oneof![
        atom(object()).prop_map(InitElement::Atom),
        atom(object()).prop_map(InitElement::Not),
        atom(object()).prop_map(InitElement::Unknown),
        (fluent(object()), number()).prop_map(|(fluent, it)| InitElement::Assign(fluent, it)),
    ];
    let leaf = leaf.boxed();
    let timed = (number(), leaf.clone().prop_map(Box::new));
    prop_oneof![leaf, timed.prop_map(|(time, inner)| InitElement::At(time, inner))]
}

fn metric() -> impl Strategy<Value = Metric> {
    let span = Span::default();
    let direction =
        proptest::sample::select(vec![MetricDirection::Minimize, MetricDirection::Maximize]);
    (direction, expression(vec![Expression::TotalTime(span)]))
        .prop_map(move |(direction, expression)| Metric { direction, expression, span })
}

fn requirements() -> impl Strategy<Value = Vec<Name>> {
    vec("[a-z]{1,5}".prop_map(|word| Name::new(&format!(":{word}"))), 0..3)
}

fn domain() -> impl Strategy<Value = Domain> {
    let declared = (typed_list(), typed_list(), vec(predicate(), 0..4), vec(function(), 0..4));
    let actions = (vec(derived(), 0..2), vec(action(), 0..2), vec(durative_action(), 0..2));
    (name(), requirements(), declared, actions).prop_map(
        |(name, requirements, declared, actions)| {
            let (types, constants, predicates, functions) = declared;
            let (derived, actions, durative_actions) = actions;
            Domain {
                name,
                requirements,
                types,
                constants,
                predicates,
                functions,
                derived,
                actions,
                durative_actions,
            }
        },
    )
}

fn problem() -> impl Strategy<Value = Problem> {
    let stated = (objects(), vec(init_element(), 0..4));
    let wanted = (condition(plain_expression()), option::of(metric()));
    (name(), name(), requirements(), stated, wanted).prop_map(
        |(name, domain, requirements, (objects, init), (goal, metric))| Problem {
            name,
            domain,
            requirements,
            objects: Arc::new(objects),
            init,
            goal,
            metric,
        },
    )
}

/// Generates an action model with the declarations of a domain and the content of a problem.
fn action_model() -> impl Strategy<Value = ActionModel> {
    (domain(), problem()).prop_map(|(domain, problem)| ActionModel {
        agent: problem.name,
        domain: domain.name,
        requirements: domain.requirements,
        types: domain.types,
        predicates: domain.predicates,
        functions: domain.functions,
        objects: problem.objects.to_vec(),
        init: problem.init,
        derived: domain.derived,
        actions: domain.actions,
        durative_actions: domain.durative_actions,
    })
}

pub(crate) fn document() -> impl Strategy<Value = Document> {
    prop_oneof![
        domain().prop_map(Document::Domain),
        problem().prop_map(Document::Problem),
        action_model().prop_map(Document::ActionModel),
    ]
}

pub(crate) fn goal() -> impl Strategy<Value = Condition> {
    condition(plain_expression())
}

pub(crate) fn plan() -> impl Strategy<Value = Plan> {
    let span = Span::default();
    let step = (name(), vec(name(), 0..3), option::of(number()), option::of(number()));
    let step = step.prop_map(move |(action, arguments, time, duration)| PlanStep {
        action,
        arguments,
        time,
        duration,
        span,
    });
    (vec(step, 0..4), option::of(number())).prop_map(|(steps, cost)| Plan { steps, cost })
}
