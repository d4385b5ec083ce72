//! Tests of syntax mistakes. Each mistake is reported once, at its place, with a proposal for a
//! correction.

use expect_test::{Expect, expect};

/// Compares the diagnostics of a text, one on each line with its notes indented, and then the
/// resulting tree with `expected`.
#[track_caller]
fn check(text: &str, expected: Expect) {
    let parsed = pddl::parse_document(text);
    let mut report = String::new();
    for diagnostic in &parsed.diagnostics {
        let marked = &text[diagnostic.span.range()];
        report += &format!("{}\n  at `{}`\n", diagnostic.located(text), marked);
        for note in &diagnostic.notes {
            let (line, column) = pddl::line_column(text, note.span.start as usize);
            report += &format!("  {line}:{column}: {}\n", note.message);
        }
    }
    report += &parsed.value.map_or("nothing\n".to_owned(), |value| value.to_string());
    expected.assert_eq(&report);
}

#[test]
fn an_unclosed_section_causes_one_message() {
    check(
        "(define (domain d)\n (:predicates (p) (q)\n (:action a\n  :effect (p)))",
        expect![[r#"
            2:2: error: unclosed `(`; add `)` before `(:action`
              at `(`
              3:2: `(:action` begins while it is still open
            (define (domain d)
              (:predicates (p) (q))
              (:action a
                :parameters ()
                :effect (p)))
        "#]],
    );
}

#[test]
fn an_unclosed_condition_ends_before_the_effect() {
    check(
        "(define (domain d)\n (:action a\n  :precondition (and (p) (not (q))\n  :effect (p))\n (:action b))",
        expect![[r#"
            3:17: error: unclosed `(`; add `)` before `:effect`
              at `(`
              4:3: `:effect` begins while it is still open
            (define (domain d)
              (:action a
                :parameters ()
                :precondition (and (p) (not (q)))
                :effect (p))
              (:action b
                :parameters ()))
        "#]],
    );
}

#[test]
fn an_extra_parenthesis_does_not_lose_the_rest() {
    check(
        "(define (domain d)\n (:predicates (p)))\n (:action a))",
        expect![[r#"
        2:19: error: this `)` closes `(define` too early; remove it
          at `)`
          3:2: `(:action` stands outside of `(define`
        (define (domain d)
          (:predicates (p))
          (:action a
            :parameters ()))
    "#]],
    );
    check(
        "(define (domain d)))))",
        expect![[r#"
            1:20: warning: `)` after the end closes nothing; remove it
              at `)`
            (define (domain d))
        "#]],
    );
}

#[test]
fn an_unclosed_file_points_at_the_opening() {
    check(
        "(define (domain d)\n (:predicates (p)",
        expect![[r#"
        2:2: error: unclosed `(`; 2 are open at the end of the text
          at `(`
          1:1: the outermost is here
        (define (domain d)
          (:predicates (p)))
    "#]],
    );
}

#[test]
fn a_missing_part_at_the_end_is_marked_at_a_character() {
    check(
        "(define (problem p) (:domain d) (:goal (imply ä",
        expect![[r#"
        1:40: error: unclosed `(`; 3 are open at the end of the text
          at `(`
          1:1: the outermost is here
        1:47: error: expected a condition, found `ä`; write `(ä)` [(PREDICATE TERM*) | (not|and|or|imply CONDITION*) | (exists|forall (VARIABLES) CONDITION) | (= TERM TERM) | (COMPARISON EXPRESSION EXPRESSION)]
          at `ä`
        1:48: error: missing second condition [(imply CONDITION CONDITION)]
          at ``
        (define (problem p)
          (:domain d)
          (:goal (and)))
    "#]],
    );
}

#[test]
fn errors_in_sections() {
    check(
        "(define (domain d) (:predicats (p)) (:init (p)) (:foo) (:length 3) (:constraints) stray ()
           (:types a) (:types b))",
        expect![[r#"
            1:21: error: unknown section `:predicats`; did you mean `:predicates`?
              at `:predicats`
            1:38: error: `:init` belongs to problems and action models
              at `:init`
            1:50: error: unknown section `:foo`; known are :requirements :types :constants :predicates :functions :derived :action :durative-action
              at `:foo`
            1:57: warning: `:length` is obsolete and passed over
              at `:length`
            1:69: error: constraints on trajectories (`:constraints`) are not supported
              at `:constraints`
            1:83: error: expected a section, found `stray` [(:KEYWORD …)]
              at `stray`
            1:90: error: missing keyword [(:KEYWORD …)]
              at `)`
            2:24: warning: a second `:types` section; it is read as if joined to the first
              at `:types`
              2:13: the first is here
            (define (domain d)
              (:types a b))
        "#]],
    );
}

#[test]
fn errors_in_agents_of_actions() {
    check(
        "(define (domain d) (:action a :agent () :effect (p)) (:action b :agent (robot) :effect (p))
           (:durative-action c :agent (?r ?s - t) :duration (= ?duration 1) :effect ())
           (:action d :agent ?a ?b - robot :parameters (?x) :effect (p)))",
        expect![[r#"
            1:38: error: `:agent` names no variable [:agent (VARIABLES)]
              at `()`
            1:72: error: `:agent` names no variable [:agent (VARIABLES)]
              at `(robot)`
            1:73: error: expected a variable, found `robot`; write `?robot` [VARIABLE = ?NAME]
              at `robot`
            2:43: error: a durative action has one agent [:agent VARIABLE - TYPE]
              at `?s`
            3:30: error: the parentheses around the variables are missing; write `(?a ?b - robot)` [:agent (VARIABLES)]
              at `?a`
            (define (domain d)
              (:action a
                :parameters ()
                :effect (p))
              (:action b
                :parameters ()
                :effect (p))
              (:action d
                :agent (?a ?b - robot)
                :parameters (?x)
                :effect (p))
              (:durative-action c
                :agent ?r - t
                :parameters ()
                :duration (= ?duration 1)
                :condition ()
                :effect (and)))
        "#]],
    );
}

#[test]
fn errors_in_parts_of_actions() {
    check(
        "(define (domain d) (:action a :parameter (?x) :effect (p) stray :effect (q)
           :agent ?x - t :agent ?y - t :precondition :vars (?z)) (:action (b)))",
        expect![[r#"
            1:31: error: unknown keyword `:parameter`; did you mean `:parameters`?
              at `:parameter`
            1:59: error: expected a keyword, found `stray` [(:action NAME [:agent VARIABLE - TYPE | :agent (VARIABLES)] [:parameters (VARIABLES)] [:precondition CONDITION] [:effect EFFECT] [:observe OBSERVED])]
              at `stray`
            1:65: error: `:effect` is given twice
              at `:effect`
              1:47: the first is here
            2:26: error: `:agent` is given twice
              at `:agent`
              2:12: the first is here
            2:40: error: nothing follows `:precondition` [(:action NAME [:agent VARIABLE - TYPE | :agent (VARIABLES)] [:parameters (VARIABLES)] [:precondition CONDITION] [:effect EFFECT] [:observe OBSERVED])]
              at `:precondition`
            2:54: warning: `:vars` are read as further parameters; write them into `:parameters`
              at `:vars`
            2:75: error: expected the name of the action, found `(b)` [NAME = a letter or digit, then letters, digits, `-` and `_`]
              at `(b)`
            (define (domain d)
              (:action a
                :agent ?x - t
                :parameters (?z)
                :effect (p)))
        "#]],
    );
}

#[test]
fn errors_in_definitions() {
    check(
        "(define (domian d) (:predicates (p)))",
        expect![[r#"
            1:10: error: unknown kind of definition `domian`; did you mean `domain`?
              at `domian`
            (define (domain d)
              (:predicates (p)))
        "#]],
    );
    check(
        "(defin (domain d))",
        expect![[r#"
            1:2: error: expected `define`, found `defin` [(define (domain|problem|agent NAME) SECTION*)]
              at `defin`
            (define (domain d))
        "#]],
    );
    check(
        "(define (problem))",
        expect![[r#"
            1:17: error: missing name [(define (domain|problem|agent NAME) SECTION*)]
              at `)`
            1:18: error: missing `(:domain NAME)` [(:domain NAME)]
              at `)`
            (define (problem unnamed)
              (:domain unnamed)
              (:goal (and)))
        "#]],
    );
    check(
        "domain",
        expect![[r#"
        1:1: error: expected a definition, found `domain` [(define (domain|problem|agent NAME) SECTION*)]
          at `domain`
        nothing
    "#]],
    );
    check(
        "; nothing\n",
        expect![[r#"
        2:1: error: the text holds no definition
          at ``
        nothing
    "#]],
    );
    check(
        "(define (domain d)) (define (domain e))",
        expect![[r#"
        1:21: error: one definition is expected, `(define (domain e))` is more
          at `(define (domain e))`
        (define (domain d))
    "#]],
    );
    let expected = pddl::parse_problem("(define (domain d))").into_result();
    assert_eq!(expected.unwrap_err()[0].to_string(), "error: expected a problem, found a domain");
}

#[test]
fn errors_in_conditions() {
    check(
        "(define (problem p) (:domain d) (:goal (and p (not) (not (p) (q)) (imply (p)) (frall (?x) (p))
           ((p)) (p (q)) (exists (x) (p)) (exists ?x (p)) (= a) (< 1) (when (p) (q)) (p ?)
           (preference n (p)) (increase (f) 1) (< ?x 1) (> (+ 1) 2) (> (/ 1 2 3) #t))))",
        expect![[r#"
            1:45: error: expected a condition, found `p`; write `(p)` [(PREDICATE TERM*) | (not|and|or|imply CONDITION*) | (exists|forall (VARIABLES) CONDITION) | (= TERM TERM) | (COMPARISON EXPRESSION EXPRESSION)]
              at `p`
            1:51: error: missing condition [(not CONDITION)]
              at `)`
            1:62: error: `not` ends before `(q)`; several are joined by `(and …)` [(not CONDITION)]
              at `(q)`
            1:77: error: missing second condition [(imply CONDITION CONDITION)]
              at `)`
            1:80: error: unknown keyword `frall`; did you mean `forall`?
              at `frall`
            2:13: error: a condition begins with a word, not with `(p)`; several are joined by `(and …)` [(PREDICATE TERM*) | (not|and|or|imply CONDITION*) | (exists|forall (VARIABLES) CONDITION) | (= TERM TERM) | (COMPARISON EXPRESSION EXPRESSION)]
              at `(p)`
            2:21: error: expected a variable or an object, found `(q)` [(PREDICATE TERM*)]
              at `(q)`
            2:35: error: expected a variable, found `x`; write `?x` [VARIABLE = ?NAME]
              at `x`
            2:51: error: the parentheses around the variables are missing; write `(?x)` [(exists|forall (VARIABLES) CONDITION)]
              at `?x`
            2:63: error: missing second term [(= TERM TERM) | (= EXPRESSION EXPRESSION)]
              at `)`
            2:69: error: missing second expression [(COMPARISON EXPRESSION EXPRESSION)]
              at `)`
            2:71: error: `when` belongs to effects; write `imply`
              at `(when (p) (q))`
            2:89: error: expected a variable, found `?` [NAME = a letter or digit, then letters, digits, `-` and `_`]
              at `?`
            3:12: error: preferences are not supported
              at `(preference n (p))`
            3:31: error: a numeric effect is no condition; compare with `<`, `<=`, `=`, `>=` or `>`
              at `(increase (f) 1)`
            3:51: error: expected an expression, found the variable `?x`; apply a function: `(FUNCTION ?x)` [NUMBER | (FUNCTION TERM*) | (- EXPRESSION) | (+|* EXPRESSION EXPRESSION+) | (-|/ EXPRESSION EXPRESSION)]
              at `?x`
            3:60: error: wrong number of operands: 1 [NUMBER | (FUNCTION TERM*) | (- EXPRESSION) | (+|* EXPRESSION EXPRESSION+) | (-|/ EXPRESSION EXPRESSION)]
              at `(+ 1)`
            3:72: error: wrong number of operands: 3 [NUMBER | (FUNCTION TERM*) | (- EXPRESSION) | (+|* EXPRESSION EXPRESSION+) | (-|/ EXPRESSION EXPRESSION)]
              at `(/ 1 2 3)`
            3:82: error: `#t` has a value only in a durative action
              at `#t`
            (define (problem p)
              (:domain d)
              (:goal (and (not (p)) (exists () (p)) (exists (?x) (p)))))
        "#]],
    );
}

#[test]
fn errors_in_effects() {
    check(
        "(define (domain d) (:action a :effect (and p (not (not (p))) (or (p)) (imply (p) (q))
           (= (f) 1) (increase (f)) (incrase (f) 1) (forall (?x)) (assign 5 (f)) (assign (+ 1 2) 3))))",
        expect![[r#"
            1:44: error: expected an effect, found `p`; write `(p)` [(PREDICATE TERM*) | (not (PREDICATE TERM*)) | (and EFFECT*) | (when CONDITION EFFECT) | (forall (VARIABLES) EFFECT) | (ASSIGNMENT FLUENT EXPRESSION)]
              at `p`
            1:52: error: expected a predicate, found `not` [(PREDICATE TERM*)]
              at `not`
            1:62: error: an effect must be certain; `or` is for conditions
              at `(or (p))`
            1:71: error: `imply` belongs to conditions; write `when`
              at `(imply (p) (q))`
            2:12: error: `=` is a condition; write `(assign FLUENT EXPRESSION)`
              at `(= (f) 1)`
            2:35: error: missing value [(assign|increase|decrease|scale-up|scale-down FLUENT EXPRESSION)]
              at `)`
            2:38: error: unknown keyword `incrase`; did you mean `increase`?
              at `incrase`
            2:65: error: missing effect [(forall (VARIABLES) EFFECT)]
              at `)`
            2:75: error: expected a function, found `5` [(FUNCTION TERM*)]
              at `5`
            2:91: error: expected a function, found `+` [(FUNCTION TERM*)]
              at `+`
            (define (domain d)
              (:action a
                :parameters ()))
        "#]],
    );
}

#[test]
fn conditions_of_durative_actions_need_a_time() {
    check(
        "(define (domain d) (:durative-action a :duration (and (= 5 ?duration) (< ?duration 5))
           :condition (and (p) (at noon (p)) (over any (p))) :effect (and (q) (over all (p)))))",
        expect![[r#"
            1:58: error: a duration constrains `?duration`, on the left [() | (=|<=|>= ?duration EXPRESSION) | (at start|end DURATION) | (and DURATION*)]
              at `5`
            1:71: error: unknown duration `(< ?duration 5)`; known are = <= >= and at
              at `(< ?duration 5)`
            2:28: error: this condition of a durative action says no time; write `(at start …)`, `(at end …)` or `(over all …)` [() | (at start|end CONDITION) | (over all CONDITION) | (and TIMED*) | (forall (VARIABLES) TIMED)]
              at `(p)`
            2:32: error: no such time; write `at start …` or `at end …`
              at `(at noon (p))`
            2:52: error: no such time; write `over all`
              at `any`
            2:75: error: this effect of a durative action says no time; write `(at start …)`, `(at end …)` or `(over all …)` [() | (at start|end EFFECT) | (and TIMED*) | (forall (VARIABLES) TIMED) | (when TIMED-CONDITION TIMED) | (increase|decrease FLUENT EXPRESSION-WITH-#t)]
              at `(q)`
            2:79: error: no effect lasts `over all`; write `at end`
              at `(over all (p))`
            (define (domain d)
              (:durative-action a
                :parameters ()
                :duration (= ?duration ?duration)
                :condition ()
                :effect (and)))
        "#]],
    );
}

#[test]
fn errors_in_declarations() {
    check(
        "(define (domain d) (:requirements typing (x)) (:types a - (either) b - c -d e -)
           (:predicates p (and ?x) (q x) (:private ?a ?b (r))) (:functions (f) - integer (f)))",
        expect![[r#"
            1:35: error: expected a requirement, found `typing`; write `:typing` [(:requirements :NAME*)]
              at `typing`
            1:42: error: expected a requirement, found `(x)` [(:requirements :NAME*)]
              at `(x)`
            1:59: error: expected a type, found `(either)` [TYPE = NAME | (either NAME+)]
              at `(either)`
            1:74: warning: no space between `-` and `d`; write `- d`
              at `-d`
            1:79: error: no type after `-` [TYPE = NAME | (either NAME+)]
              at `-`
            2:25: error: expected a declaration, found `p` [(:predicates (NAME [VARIABLE* [- TYPE]]*)*)]
              at `p`
            2:28: error: `and` is a word of PDDL and cannot be declared
              at `and`
            2:39: error: expected a variable, found `x`; write `?x` [VARIABLE = ?NAME]
              at `x`
            2:55: error: a `:private` has one owner, `?b` is another [(:private [VARIABLE - TYPE] DECLARATION*)]
              at `?b`
            2:82: error: functions with objects as values (here `integer`) are not supported [(:functions ((NAME [VARIABLE* [- TYPE]]*)* [- number])*)]
              at `integer`
            (define (domain d)
              (:types a - object b - c e)
              (:predicates (and ?x) (q) (:private ?a (r)))
              (:functions (f) - number (f) - number))
        "#]],
    );
}

#[test]
fn errors_in_facts() {
    check(
        "(define (problem p) (:domain d) (:init (p ?x) (= (f) x) (= (f ?y) 1) (and (p)) (at 5 (at 6 (p))))
           (:goal (p) (q)) (:metric minimise (f)))",
        expect![[r#"
            1:43: error: `?x` is a variable, and facts are about objects
              at `?x`
            1:54: error: expected a number, found `x` [(= FLUENT NUMBER)]
              at `x`
            1:63: error: `?y` is a variable, and facts are about objects
              at `?y`
            1:71: error: facts stand side by side; leave `and` out [(PREDICATE NAME*) | (not (PREDICATE NAME*)) | (unknown (PREDICATE NAME*)) | (= FLUENT NUMBER) | (at NUMBER ELEMENT)]
              at `and`
            1:86: error: a fact has one time [(PREDICATE NAME*) | (not (PREDICATE NAME*)) | (unknown (PREDICATE NAME*)) | (= FLUENT NUMBER) | (at NUMBER ELEMENT)]
              at `(at 6 (p))`
            2:23: error: a goal is one condition, `(q)` is another; join them: `(and …)` [(:goal CONDITION)]
              at `(q)`
            2:37: error: unknown direction `minimise`; did you mean `minimize`?
              at `minimise`
            (define (problem p)
              (:domain d)
              (:goal (p)))
        "#]],
    );
    check(
        "(define (problem p) (:init))",
        expect![[r#"
        1:28: error: missing `(:domain NAME)` [(:domain NAME)]
          at `)`
        (define (problem p)
          (:domain unnamed)
          (:goal (and)))
    "#]],
    );
}

#[test]
fn names_contain_no_invalid_characters() {
    check(
        "(define (domain d\u{a0}e) (:predicates (\"p\") (:q) (?r) (ö)))",
        expect![[r#"
            1:18: error: U+00A0 (no-break space) is no space in PDDL; write a space
              at ` `
            1:19: error: the name ends before `e` [(define (domain|problem|agent NAME) SECTION*)]
              at `e`
            1:36: error: expected a name, found `"p"`; a name cannot hold `"` [NAME = a letter or digit, then letters, digits, `-` and `_`]
              at `"p"`
            1:42: error: expected a name, found `:q` [NAME = a letter or digit, then letters, digits, `-` and `_`]
              at `:q`
            1:47: error: expected a name, found `?r`; variables have no place here [NAME = a letter or digit, then letters, digits, `-` and `_`]
              at `?r`
            (define (domain d)
              (:predicates (ö)))
        "#]],
    );
}

/// Compares the diagnostics of a plan with `expected`.
#[track_caller]
fn check_plan(text: &str, expected: Expect) {
    let lines: Vec<_> =
        pddl::parse_plan(text).diagnostics.iter().map(|it| it.located(text) + "\n").collect();
    expected.assert_eq(&lines.concat());
}

#[test]
fn errors_in_plans() {
    check_plan(
        "move a b\n(move ?x)\n((a))\n[1.0]\n(a) [x]\n()\n1: 2: (a)",
        expect![[r#"
            1:1: error: expected a step, found `move` [[TIME:] (ACTION NAME*) [[DURATION]]]
            1:6: error: expected a step, found `a` [[TIME:] (ACTION NAME*) [[DURATION]]]
            1:8: error: expected a step, found `b` [[TIME:] (ACTION NAME*) [[DURATION]]]
            2:7: error: expected an object, found `?x`; variables have no place here [NAME = a letter or digit, then letters, digits, `-` and `_`]
            3:2: error: expected an action, found `(a)` [NAME = a letter or digit, then letters, digits, `-` and `_`]
            4:1: error: expected a step, found `[1.0]` [[TIME:] (ACTION NAME*) [[DURATION]]]
            5:5: error: expected a step, found `[x]` [[TIME:] (ACTION NAME*) [[DURATION]]]
            6:2: error: missing action [[TIME:] (ACTION NAME*) [[DURATION]]]
            7:4: error: expected a step, found `2:` [[TIME:] (ACTION NAME*) [[DURATION]]]
        "#]],
    );
}

#[test]
fn the_number_of_listed_errors_is_limited() {
    let text = "(define (domain d) ".to_owned() + &"x ".repeat(5_000) + ")";
    let diagnostics = pddl::parse_document(&text).diagnostics;
    assert_eq!(diagnostics.len(), 1_001);
    assert_eq!(diagnostics[1_000].message, "4000 more mistakes are not listed");
}

#[test]
fn several_conditions_need_an_and() {
    check(
        "(define (domain d) (:predicates (p) (q)) (:action a :parameters ()
           :precondition (p) (q) :effect (p) (not (q))) (:derived (p) (q) (q)))",
        expect![[r#"
            2:30: error: `:precondition` is one condition, `(q)` is another; join them: `(and …)`
              at `(q)`
            2:46: error: `:effect` is one effect, `(not (q))` is another; join them: `(and …)`
              at `(not (q))`
            2:75: error: an axiom ends before `(q)`; several are joined by `(and …)` [(:derived (PREDICATE VARIABLES) CONDITION)]
              at `(q)`
            (define (domain d)
              (:predicates (p) (q))
              (:derived (p)
                (q))
              (:action a
                :parameters ()
                :precondition (p)
                :effect (p)))
        "#]],
    );
    check(
        "(define (problem p) (:domain d) (:goal (p) (q)))",
        expect![[r#"
            1:44: error: a goal is one condition, `(q)` is another; join them: `(and …)` [(:goal CONDITION)]
              at `(q)`
            (define (problem p)
              (:domain d)
              (:goal (p)))
        "#]],
    );
    check(
        "(define (domain d) (:predicates (p ?x) (q)) (:action a :parameters ()
           :precondition (forall (?x) (p ?x) (q)) :effect (when (q) (p) (q))))",
        expect![[r#"
            2:46: error: a quantifier ends before `(q)`; several are joined by `(and …)` [(exists|forall (VARIABLES) CONDITION)]
              at `(q)`
            2:73: error: `when` ends before `(q)`; several are joined by `(and …)` [(when CONDITION EFFECT)]
              at `(q)`
            (define (domain d)
              (:predicates (p ?x) (q))
              (:action a
                :parameters ()
                :precondition (forall (?x) (p ?x))
                :effect (when (q) (p))))
        "#]],
    );
}

#[test]
fn words_must_be_inside_their_parentheses() {
    check(
        "(define (problem p) (:domain d) (:init at(r1, hall) (q)) (:goal (and at(r1, attic) (q))))",
        expect![[r#"
            1:40: error: `at` stands before its parentheses; write `(at r1 hall)`
              at `at(r1, hall)`
            1:70: error: `at` stands before its parentheses; write `(at r1 attic)`
              at `at(r1, attic)`
            (define (problem p)
              (:domain d)
              (:init (q))
              (:goal (and (q))))
        "#]],
    );
    check(
        "(define (domain d) (:predicates at(?x) (q)) (:action a :parameters (?x)
           :precondition at(?x) :effect not(at(?x))))",
        expect![[r#"
            1:33: error: `at` stands before its parentheses; write `(at ?x)`
              at `at(?x)`
            2:26: error: `at` stands before its parentheses; write `(at ?x)`
              at `at(?x)`
            2:41: error: `not` stands before its parentheses; write `(not …)`
              at `not(at(?x))`
            (define (domain d)
              (:predicates (q))
              (:action a
                :parameters (?x)))
        "#]],
    );
    check(
        "(define (problem p) (:domain d) (:objects a, b) (:init (at a, b)))",
        expect![[r#"
            1:43: error: expected a name, found `a,`; separate names by spaces, not by commas [NAME = a letter or digit, then letters, digits, `-` and `_`]
              at `a,`
            1:60: error: expected a variable or an object, found `a,`; separate names by spaces, not by commas [NAME = a letter or digit, then letters, digits, `-` and `_`]
              at `a,`
            (define (problem p)
              (:domain d)
              (:objects b - object)
              (:goal (and)))
        "#]],
    );
}

#[test]
fn comments_begin_with_a_semicolon() {
    check(
        "# lamps (all of them\n(define (domain d) // a (domain\n(:predicates (p)) /* more\n (and more */)",
        expect![[r#"
            1:1: error: `#` begins no comment in PDDL; begin each line of a comment with `;`
              at `#`
            2:20: error: `//` begins no comment in PDDL; begin each line of a comment with `;`
              at `//`
            3:19: error: `/*` begins no comment in PDDL; begin each line of a comment with `;`
              at `/*`
            (define (domain d)
              (:predicates (p)))
        "#]],
    );
}

#[test]
fn a_comment_of_another_language_ends_where_it_ends_there() {
    check(
        "(define (domain d) /*/ (domain */(:predicates (p)) /* old */(:constants a))",
        expect![[r#"
            1:20: error: `/*` begins no comment in PDDL; begin each line of a comment with `;`
              at `/*`
            1:52: error: `/*` begins no comment in PDDL; begin each line of a comment with `;`
              at `/*`
            (define (domain d)
              (:constants a)
              (:predicates (p)))
        "#]],
    );
}

#[test]
fn symbols_for_operators_are_corrected() {
    check(
        "(define (domain d) (:predicates (p ?x) (q)) (:action a :parameters (?x ?y)
           :precondition (and (!= ?x ?y) (== ?x ?y) (! (q)) (&& (q) (q)) (-> (q) (q)))
           :effect (and (p ?x) (+= (f) 1))))",
        expect![[r#"
            2:32: error: PDDL has no `!=`; write `(not (= … …))`
              at `!=`
            2:43: error: PDDL has no `==`; write `(= … …)`
              at `==`
            2:54: error: PDDL has no `!`; write `(not …)`
              at `!`
            2:62: error: PDDL has no `&&`; write `(and … …)`
              at `&&`
            2:75: error: PDDL has no `->`; write `(imply … …)`
              at `->`
            3:33: error: PDDL has no `+=`; write `(increase FLUENT EXPRESSION)`
              at `+=`
            (define (domain d)
              (:predicates (p ?x) (q))
              (:action a
                :parameters (?x ?y)
                :effect (and (p ?x))))
        "#]],
    );
}

#[test]
fn a_type_needs_a_dash() {
    check(
        "(define (domain d) (:types room) (:predicates (p ?x room)) (:action a :parameters (?x room ?y)))",
        expect![[r#"
            1:53: error: expected a variable, found `room`; write `- room` for the type of the variable before it, or `?room` [VARIABLE = ?NAME]
              at `room`
            1:87: error: expected a variable, found `room`; write `- room` for the type of the variable before it, or `?room` [VARIABLE = ?NAME]
              at `room`
            (define (domain d)
              (:types room)
              (:predicates (p ?x))
              (:action a
                :parameters (?x ?y)))
        "#]],
    );
}
