//! Checks with random goals of the standard ontology: what is said is read back as the same goal, in
//! each language; and no text causes a panic.

use pddl::*;
use phrases::{KnownNames, Language, Phrasebook};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

/// Predicates with their numbers of arguments; the last two have no words.
const PREDICATES: &[(&str, usize)] = &[
    ("known-temperature", 1),
    ("known-co2", 1),
    ("motion", 1),
    ("lit", 1),
    ("closed", 1),
    ("patrolled", 1),
    ("swept", 1),
    ("at", 2),
    ("connected", 2),
    ("presented", 2),
    ("shows", 3),
    ("presenting", 1),
    ("without-words", 1),
    ("at", 3),
];

/// Functions with their numbers of arguments; the last one has no words.
const FUNCTIONS: &[(&str, usize)] =
    &[("temperature", 1), ("humidity", 1), ("distance", 2), ("speed", 1), ("total-cost", 0)];

/// Names of objects, some of which are words of the languages, too.
const OBJECTS: &[&str] =
    &["office1", "Hall", "r", "known", "and", "oder", "every", "not", "m", "ä-1"];

const TYPES: &[&str] = &["room", "location", "mobile-base", "Airlock", "object", "camera"];

const VARIABLES: &[&str] = &["r", "l", "m", "r2", "Place", "hall", "and"];

fn term() -> impl Strategy<Value = Term> {
    let object = select(OBJECTS).prop_map(|name| Term::Object(Name::new(name)));
    let variable = select(VARIABLES).prop_map(|name| Term::Variable(Name::new(name)));
    prop_oneof![3 => object, 2 => variable]
}

fn terms(arity: usize) -> impl Strategy<Value = Vec<Term>> {
    vec(term(), arity)
}

fn fluent() -> impl Strategy<Value = FluentTerm> {
    let span = Span::default();
    select(FUNCTIONS).prop_flat_map(move |(name, arity)| {
        terms(arity).prop_map(move |arguments| FluentTerm {
            function: Name::new(name),
            arguments,
            span,
        })
    })
}

fn expression() -> impl Strategy<Value = Expression> {
    let number = prop_oneof![
        (-50_i32..50).prop_map(f64::from),
        (-500_i32..500).prop_map(|tenths| f64::from(tenths) / 10.0),
        any::<f64>().prop_filter("numbers are finite", |number| number.is_finite()),
    ];
    let number = number.prop_map(|number| Expression::Number(Number(number)));
    prop_oneof![3 => number, 1 => fluent().prop_map(Expression::Fluent)]
}

fn comparison() -> impl Strategy<Value = Comparison> {
    use Comparison::*;
    select(vec![Less, LessOrEqual, Equal, GreaterOrEqual, Greater])
}

fn leaf() -> impl Strategy<Value = Condition> {
    let span = Span::default();
    let atom = select(PREDICATES).prop_flat_map(move |(name, arity)| {
        terms(arity).prop_map(move |arguments| {
            Condition::Atom(Atom { predicate: Name::new(name), arguments, span })
        })
    });
    let compare =
        (comparison(), fluent(), expression()).prop_map(move |(comparison, left, right)| {
            let left = Expression::Fluent(left);
            Condition::Compare(Box::new(Compare { comparison, left, right, span }))
        });
    let same = (term(), term()).prop_map(move |(one, other)| Condition::Equal(one, other, span));
    prop_oneof![4 => atom, 2 => compare, 1 => same]
}

fn variables() -> impl Strategy<Value = Vec<Typed>> {
    let typed = (select(VARIABLES), select(TYPES))
        .prop_map(|(name, ty)| Typed { name: Name::new(name), ty: TypeExpr::of(ty) });
    vec(typed, 0..3)
}

fn goal() -> impl Strategy<Value = Condition> {
    leaf().prop_recursive(5, 24, 3, |inner| {
        let boxed = || inner.clone().prop_map(Box::new);
        let one = || {
            (select(VARIABLES), select(TYPES))
                .prop_map(|(name, ty)| vec![Typed { name: Name::new(name), ty: TypeExpr::of(ty) }])
        };
        prop_oneof![
            2 => boxed().prop_map(Condition::Not),
            3 => vec(inner.clone(), 0..4).prop_map(Condition::And),
            3 => vec(inner.clone(), 0..4).prop_map(Condition::Or),
            1 => (boxed(), boxed()).prop_map(|(left, right)| Condition::Imply(left, right)),
            2 => (one(), boxed()).prop_map(|(one, inner)| Condition::Forall(one, inner)),
            2 => (one(), boxed()).prop_map(|(one, inner)| Condition::Exists(one, inner)),
            1 => (variables(), boxed()).prop_map(|(all, inner)| Condition::Forall(all, inner)),
        ]
    })
}

/// Generates goals of the kind that people ask for: conjunctions of facts about objects and rooms.
fn plain_goal() -> impl Strategy<Value = Condition> {
    let place =
        || prop_oneof![Just("office1"), Just("hall"), Just("every room"), Just("some room")];
    let fact =
        (select(&["known-temperature", "motion", "swept", "lit"][..]), place(), any::<bool>());
    let fact = fact.prop_map(|(predicate, place, is_negated)| {
        let (term, quantifier) = match place {
            "every room" => ("?r", Some("forall")),
            "some room" => ("?r", Some("exists")),
            object => (object, None),
        };
        let atom = format!("({predicate} {term})");
        let core = if is_negated { format!("(not {atom})") } else { atom };
        match quantifier {
            Some(quantifier) => format!("({quantifier} (?r - room) {core})"),
            None => core,
        }
    });
    vec(fact, 1..5).prop_map(|facts| {
        let text = match facts.as_slice() {
            [only] => only.clone(),
            facts => format!("(and {})", facts.join(" ")),
        };
        pddl::parse_condition(&text).into_result().expect("PDDL")
    })
}

fn books() -> [Phrasebook; 2] {
    Language::ALL.map(Phrasebook::standard)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn what_is_said_is_read_back(goal in goal()) {
        for book in books() {
            let said = book.say(&goal);
            let read = book.read(&said, &KnownNames::default());
            prop_assert_eq!(read.as_ref(), Ok(&goal), "{}", said);
            // And the PDDL of it is the same goal, because that is what travels.
            let text = book.parse(&said, &KnownNames::default()).expect("it was read");
            let again = pddl::parse_condition(&text).into_result().expect("PDDL");
            prop_assert_eq!(&again, &goal, "{}", text);
        }
    }

    #[test]
    fn plain_goals_have_words(goal in plain_goal()) {
        for book in books() {
            let said = book.say(&goal);
            prop_assert!(!said.contains('('), "{}", said);
            prop_assert_eq!(&book.read(&said, &KnownNames::default()).expect("read"), &goal);
        }
    }

}

proptest! {
    // Each text that is not understood is compared with all phrases.
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn no_text_causes_a_panic(text in "(temperature|of|every|room|known|and|or|not|if|then|for|r|:|,|\\(|\\)|21|°C|at least|`|x|\\PC| ){0,30}") {
        for book in books() {
            let _ = book.read(&text, &KnownNames::default());
            let _ = book.complete(&text, &KnownNames::default());
            let _ = book.print_sentence(&text);
        }
    }
}
