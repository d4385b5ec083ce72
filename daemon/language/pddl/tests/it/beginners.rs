//! Tests of mistakes that beginners make. Each mistake gives one message, which contains the
//! correction.

/// Returns the errors of a text, one on each line.
fn errors(text: &str) -> String {
    let diagnostics = pddl::parse_document(text).diagnostics;
    let errors = diagnostics.iter().filter(|diagnostic| diagnostic.is_error());
    errors.map(|error| format!("{}\n", error.located(text))).collect()
}

#[test]
fn a_word_before_its_parentheses_is_one_error_in_any_place() {
    let problem = |parts: &str| format!("(define (problem p) (:domain d) {parts})");
    let action = |parts: &str| format!("(define (domain d) (:action a {parts}))");
    for text in [
        problem("(:goal at(r1, hall))"),
        problem("(:goal (not at(r1, hall)))"),
        problem("(:goal (imply at(r1) (q)))"),
        problem("(:goal (imply (q) at(r1)))"),
        problem("(:goal (forall (?x) at(?x)))"),
        problem("(:goal (> f(x) 5))"),
        problem("(:goal (= f(x) 5))"),
        problem("(:goal (> (- f(x) 1) 5))"),
        problem("(:goal (> (/ 1 f(x)) 5))"),
        problem("(:init (= f(x) 5)) (:goal (q))"),
        problem("(:init (not at(r1))) (:goal (q))"),
        problem("(:goal (q)) (:metric minimize cost(x))"),
        action(":precondition at(r1, hall) :effect (q)"),
        action(":precondition (q) :effect at(r1)"),
        action(":effect (not at(r1))"),
        action(":effect (forall (?x) at(?x))"),
        action(":effect (forall (?x) (when at(?x) (q)))"),
        action(":effect (when (q) at(r1))"),
        action(":effect (increase f(x) 2)"),
        action(":effect (increase (f) g(x))"),
        "(define (domain d) (:derived (p) at(r1)))".to_owned(),
        "(define (domain d) (:derived p(x) (q)))".to_owned(),
    ] {
        let told = errors(&text);
        assert_eq!(told.lines().count(), 1, "{text}\n{told}");
        assert!(told.contains("stands before its parentheses"), "{text}\n{told}");
    }
    // Lists may touch keywords and operators.
    let tight = problem("(:init(= (f)5)) (:goal(and(not(q))(>(-(f)1)2)(imply(q)(q))))");
    assert_eq!(errors(&tight), "");
    // The second condition of a goal is reported as one too many.
    let told = errors(&problem("(:goal at(r1) at(r2))"));
    assert_eq!(told.lines().count(), 2, "{told}");
    assert!(told.contains("a goal is one condition, `at` is another"), "{told}");
}

#[test]
fn variables_without_parentheses_are_one_error_with_a_correction() {
    let action = |parts: &str| format!("(define (domain d) (:action a {parts}))");
    for (text, cure) in [
        (action(":parameters ?r - room :effect (q)"), "write `(?r - room)`"),
        (action(":parameters ?r :effect (q ?r)"), "write `(?r)`"),
        (action(":parameters ?a ?b - room ?c :effect (q)"), "write `(?a ?b - room ?c)`"),
        (action(":parameters ?a - (either x y) :effect (q)"), "write `(?a - (either x y))`"),
        (action(":effect (q) :parameters ?r - room"), "write `(?r - room)`"),
        (action(":effect (forall ?x - room (q ?x))"), "write `(?x - room)`"),
        (action(":precondition (exists ?x ?y (q ?x)) :effect (q)"), "write `(?x ?y)`"),
        (action(":precondition (forall ?x - (either a b) (q ?x))"), "write `(?x - (either a b))`"),
    ] {
        let told = errors(&text);
        assert_eq!(told.lines().count(), 1, "{text}\n{told}");
        let message = "the parentheses around the variables are missing";
        assert!(told.contains(message) && told.contains(cure), "{text}\n{told}");
    }
}

#[test]
fn a_number_before_its_function_gets_a_correction() {
    let told = errors("(define (problem p) (:domain d) (:init (= 5 (f a)) (q)) (:goal (q)))");
    assert_eq!(told.lines().count(), 1, "{told}");
    assert!(told.contains("the number `5` stands before its function"), "{told}");
    assert!(told.contains("write `(= (f a) 5)`"), "{told}");
    // In a condition, both orders are valid.
    let told = errors("(define (problem p) (:domain d) (:goal (= 5 (f a))))");
    assert_eq!(told, "");
}

#[test]
fn the_name_of_a_lisp_package_is_ignored_in_any_case() {
    for word in ["in-package", "IN-PACKAGE", "In-Package", "In-package"] {
        let text = format!("({word} \"PDDL\")\n(define (domain d) (:predicates (p)))");
        let parsed = pddl::parse_document(&text);
        assert!(parsed.value.is_some(), "{text}");
        let told: Vec<_> = parsed.diagnostics.iter().map(|one| one.located(&text)).collect();
        assert_eq!(told.len(), 1, "{told:?}");
        assert!(told[0].contains("is of Lisp, and passed over"), "{told:?}");
    }
}

#[test]
fn a_number_with_too_many_digits_causes_a_warning() {
    for (number, read) in [
        ("9007199254740993", Some("9007199254740992")),
        ("9007199254740992", None),
        ("123456789012345", None),
        ("123456789012345678", Some("123456789012345680")),
        ("100000000000000000000000", None),
        ("0.30000000000000004", None),
        ("0.3000000000000000400", None),
        ("0.300000000000000041", Some("0.30000000000000004")),
        ("-3.14159265358979323846", Some("-3.141592653589793")),
        ("0000000000000000000.5", None),
        ("1.00000000000000000000", None),
    ] {
        let text = format!(
            "(define (problem p) (:domain d) (:init (= (f) {number})) (:goal (> (f) {number})))"
        );
        let parsed = pddl::parse_document(&text);
        let told: Vec<String> = parsed.diagnostics.iter().map(|one| one.located(&text)).collect();
        match read {
            None => assert!(told.is_empty(), "{told:?}"),
            Some(read) => {
                assert_eq!(told.len(), 2, "in `:init` and in the goal: {told:?}");
                let warning = format!("warning: `{number}` has more digits than are kept");
                assert!(told[0].contains(&warning), "{told:?}");
                assert!(told[0].contains(&format!("it is read as {read}")), "{told:?}");
            }
        }
    }
}
