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

/// Returns all mistakes of a domain and of a problem of it, first those of the form.
fn mistakes(domain: &str, problem: &str) -> String {
    let (parsed, asked) = (pddl::parse_domain(domain), pddl::parse_problem(problem));
    let located = |text: &str, found: &[pddl::Diagnostic]| -> String {
        found.iter().map(|one| one.located(text) + "\n").collect()
    };
    let mut told = located(domain, &parsed.diagnostics) + &located(problem, &asked.diagnostics);
    let (Some(tree), Some(asked)) = (parsed.value, asked.value) else { return told };
    told += &located(domain, &pddl::check_domain(&tree));
    told + &located(problem, &pddl::check_problem(&tree, &asked))
}

#[test]
fn operators_of_other_languages_are_reported_at_their_place() {
    for (condition, operator, cure) in [
        ("(implies (q) (p))", "unknown keyword `implies`", "did you mean `imply`?"),
        ("(Implies (q) (p))", "unknown keyword `Implies`", "did you mean `imply`?"),
        ("(iff (q) (p))", "unknown keyword `iff`", "(and (imply A B) (imply B A))"),
        ("(if (q) (p))", "unknown keyword `if`", "`(imply A B)` in a condition"),
        ("(xor (q) (p))", "unknown keyword `xor`", "(or (and A (not B)) (and (not A) B))"),
        ("(nand (q) (p))", "unknown keyword `nand`", "(not (and …))"),
        ("(nor (q) (p))", "unknown keyword `nor`", "(not (or …))"),
        ("(any (?x) (p))", "unknown keyword `any`", "did you mean `exists`?"),
        ("(foreach (?x) (p))", "unknown keyword `foreach`", "did you mean `forall`?"),
        ("(<=> (q) (p))", "PDDL has no `<=>`", "(and (imply A B) (imply B A))"),
        ("(≠ a b)", "PDDL has no `≠`", "(not (= … …))"),
        ("(≤ (f) 3)", "PDDL has no `≤`", "(<= … …)"),
        ("(annd (q) (p))", "unknown keyword `annd`", "did you mean `and`?"),
    ] {
        let text = format!("(define (domain d) (:action z :precondition {condition} :effect (p)))");
        let told = errors(&text);
        assert_eq!(told.lines().count(), 1, "{text}\n{told}");
        assert!(told.starts_with("1:46: error: "), "{told}");
        assert!(told.contains(operator) && told.contains(cure), "{told}");
    }
    let told = errors("(define (problem p) (:domain d) (:goal (> (min (f) 3) 1)))");
    assert_eq!(told.lines().count(), 1, "{told}");
    assert!(told.starts_with("1:44: error: PDDL has no `min`; it computes with `+`"), "{told}");
    // A predicate may have such a name.
    assert_eq!(errors("(define (domain d) (:action z :precondition (if a) :effect (any)))"), "");
}

#[test]
fn a_character_that_looks_like_another_is_named_at_its_place() {
    let domain = |parts: &str| format!("(define (domain d) {parts})");
    for (text, told, printed) in [
        (
            domain("(:predicates (p)\u{a0}(q))"),
            "1:36: error: U+00A0 (no-break space) is no space in PDDL; write a space\n",
            "(:predicates (p) (q))",
        ),
        (
            domain("(:predicates (p\u{200b}) (q))"),
            "1:35: error: U+200B (zero width space) cannot be seen; remove it\n",
            "(:predicates (p) (q))",
        ),
        (
            domain("(:types t) (:predicates (p ?x \u{2013} t))"),
            "1:50: error: U+2013 (en dash) is no `-`; write `-`\n",
            "(:predicates (p ?x - t))",
        ),
        (
            domain("(:types t) (:predicates (p ?x \u{2014}t))"),
            "1:50: error: U+2014 (em dash) is no `-`; write `-`\n",
            "(:predicates (p ?x))",
        ),
        (
            domain("(:predicates (p\u{2212}q))"),
            "1:35: error: U+2212 (minus sign) is no `-`; write `-`\n",
            "(:predicates (p\u{2212}q))",
        ),
        (
            domain("(:predicates (\u{201c}p\u{201d}))"),
            "1:34: error: U+201C (left double quotation mark) has no place in PDDL; write names \
             without quotes\n1:36: error: U+201D (right double quotation mark) has no place in \
             PDDL; write names without quotes\n",
            "(:predicates (p))",
        ),
        (
            domain("(:predicates\u{feff} (p))"),
            "1:32: error: U+FEFF (byte order mark) cannot be seen; remove it\n",
            "(:predicates (p))",
        ),
        (
            domain("(:predicates (p \u{ff1f}x))"),
            "1:36: error: U+FF1F (fullwidth question mark) is no sign of PDDL; write `?`\n",
            "(:predicates (p))",
        ),
        (
            domain("(:functions (f)) (:action a :precondition (> (f) \u{2212}5))"),
            "1:69: error: U+2212 (minus sign) is no `-`; write `-`\n",
            "(:action a",
        ),
        (
            domain("(:predicates\u{3000}\u{3000}(p) \u{200b}\n)"),
            "1:32: error: U+3000 (ideographic space) is no space in PDDL; write a space\n\
             1:33: error: U+3000 (ideographic space) is no space in PDDL; write a space\n\
             1:38: error: U+200B (zero width space) cannot be seen; remove it\n",
            "(:predicates (p))",
        ),
    ] {
        assert_eq!(errors(&text), told, "{text}");
        let tree = pddl::parse_document(&text).value.expect("a domain").to_string();
        assert!(tree.contains(printed), "{tree}");
    }
}

#[test]
fn letters_of_all_scripts_comments_and_a_byte_order_mark_at_the_start_are_no_mistakes() {
    for text in [
        "\u{feff}(define (domain d))",
        "(define (domain büro) (:predicates (м\u{2019}яч) (открыта) (می\u{200c}رود) (部屋)))",
        "(define (domain d)) ; “a\u{a0}– b” \u{200b}",
    ] {
        assert_eq!(errors(text), "", "{text}");
    }
}

#[test]
fn a_variable_can_be_compared_with_an_object_that_is_named_by_digits() {
    let domain = |constants: &str| {
        format!(
            "(define (domain d) (:constants {constants}) (:predicates (p ?x))
               (:action a :parameters (?x) :precondition (not (= ?x 1)) :effect (p ?x)))"
        )
    };
    let problem = "(define (problem q) (:domain d) (:init (p 1)) (:goal (exists (?x) (= 1 ?x))))";
    assert_eq!(mistakes(&domain("1"), problem), "");
    let tree = pddl::parse_domain(&domain("1")).into_result().expect("a domain");
    let one = pddl::Term::Object(pddl::Name::new("1"));
    let pddl::Condition::Not(inner) = &tree.actions[0].precondition else { panic!("no `not`") };
    assert!(matches!(&**inner, pddl::Condition::Equal(_, right, _) if *right == one), "{inner}");
    let goal = "(define (problem q) (:domain d) (:goal (and)))";
    expect_test::expect![[r#"
        2:69: error: unknown object `1`; a variable or an argument is an object, and no object is called so; numbers are the values of functions: `(= (FUNCTION …) NUMBER)`
    "#]]
    .assert_eq(&mistakes(&domain("k"), goal));
    // Without a variable, the form alone does not say what `1` is.
    let goal = "(define (problem q) (:domain d) (:goal (= k 1)))";
    expect_test::expect![[r#"
        1:43: error: `k` is an object, and has no value to compare or compute; only a variable can be compared with an object that is named by digits: `(= ?x 1)`
    "#]]
    .assert_eq(&mistakes(&domain("k 1"), goal));
}

#[test]
fn a_missing_name_of_the_domain_is_one_mistake() {
    let domain = "(define (domain a) (:predicates (p)))";
    let told = mistakes(domain, "(define (problem q) (:init (p)) (:goal (p)))");
    assert_eq!(told, "1:44: error: missing `(:domain NAME)` [(:domain NAME)]\n");
    let told = mistakes(domain, "(define (problem q) (:domain 'x') (:goal (p)))");
    assert_eq!(told.lines().count(), 1, "{told}");
    let told = mistakes("(define (domain 'a'))", "(define (problem q) (:domain a) (:goal (and)))");
    assert_eq!(told.lines().count(), 1, "{told}");
    // A domain may be called so.
    let told = mistakes(domain, "(define (problem q) (:domain unnamed) (:goal (p)))");
    assert_eq!(told, "1:30: warning: the domain is called `a`\n");
}

#[test]
fn an_object_declared_by_either_belongs_to_both_types() {
    let domain = "(define (domain d) (:types b c e) (:constants m - (either b c))
      (:predicates (p ?x - b) (r ?x - c) (s ?x - e)))";
    let problem = "(define (problem q) (:domain d) (:objects k l - (either b c))
      (:init (p k) (r k) (s k) (p m)) (:goal (p l)))";
    expect_test::expect![[r#"
        1:47: warning: `m` is of type `b` and of type `c`; an `either` is meant for variables: declare a type below all of these
        1:43: warning: `k` is of type `b` and of type `c`; an `either` is meant for variables: declare a type below all of these
        2:29: error: `k` is of type `(either b c)`, `s` wants `e` [(s ?x - e)]
    "#]]
    .assert_eq(&mistakes(domain, problem));
}
