//! Saying: converts a goal or a fact to a text. The text is read back before it is returned; a part
//! that would be read as something else is said in PDDL.

use pddl::{Atom, Compare, Condition, Expression, FluentTerm, InitElement, Name, Number};
use pddl::{Span, Term, TypeExpr, Typed};

use crate::default_name::default_name;
use crate::known_names::KnownNames;
use crate::pattern::{GrammaticalCase, Pattern, PhrasePart};
use crate::phrasebook::{PhraseKind, Phrasebook};
use crate::reading;

/// Says a goal.
pub(crate) fn goal(book: &Phrasebook, goal: &Condition) -> String {
    let said = Sayer { book, scope: Vec::new() }.junction(goal);
    match is_read_as(book, &said, goal) {
        true => said,
        false => goal.to_string(),
    }
}

/// Says a fact.
pub(crate) fn fact(book: &Phrasebook, fact: &InitElement) -> String {
    let condition = match fact {
        InitElement::Atom(atom) | InitElement::Unknown(atom) => Condition::Atom(atom.clone()),
        InitElement::Not(atom) => Condition::Not(Box::new(Condition::Atom(atom.clone()))),
        InitElement::Assign(fluent, number) => Condition::Compare(Box::new(Compare {
            comparison: pddl::Comparison::Equal,
            left: Expression::Fluent(fluent.clone()),
            right: Expression::Number(*number),
            span: Span::default(),
        })),
        InitElement::At(..) => return fact.to_string(),
    };
    let said = goal(book, &condition);
    match fact {
        _ if said.starts_with('(') => fact.to_string(),
        InitElement::Unknown(_) => format!("{} {said}", book.grammar.unknown),
        _ => said,
    }
}

fn is_read_as(book: &Phrasebook, said: &str, goal: &Condition) -> bool {
    reading::read(book, said, &KnownNames::default()).is_ok_and(|read| read == *goal)
}

/// A quantifier over one variable of one type.
#[derive(Clone, Copy)]
struct Quantifier<'g> {
    is_every: bool,
    variable: &'g Name,
    /// The type; `None` for `object`.
    ty: Option<&'g Name>,
}

/// Says conditions; `scope` has the variables that were named so far.
struct Sayer<'b> {
    book: &'b Phrasebook,
    scope: Vec<Name>,
}

// === impl Quantifier ===

impl<'g> Quantifier<'g> {
    /// Takes a quantifier over one variable apart. Returns `None` for other conditions.
    fn of(condition: &'g Condition) -> Option<(Quantifier<'g>, &'g Condition)> {
        let (is_every, variables, inner) = match condition {
            Condition::Forall(variables, inner) => (true, variables, inner),
            Condition::Exists(variables, inner) => (false, variables, inner),
            _ => return None,
        };
        let [Typed { name: variable, ty: TypeExpr { alternatives } }] = variables.as_slice() else {
            return None;
        };
        let ty = match alternatives.as_slice() {
            [] => None,
            [only] => Some(only),
            _ => return None,
        };
        Some((Quantifier { is_every, variable, ty }, inner))
    }

    fn ty(&self) -> Name {
        self.ty.cloned().unwrap_or_else(|| Name::new("object"))
    }
}

// === impl Sayer ===

impl Sayer<'_> {
    /// Says a whole goal: pieces joined by a comma and a connective, or one piece.
    fn junction(&mut self, goal: &Condition) -> String {
        let (parts, connective) = match goal {
            Condition::And(parts) => (parts, &self.book.grammar.and),
            Condition::Or(parts) => (parts, &self.book.grammar.or),
            _ => return self.piece(goal),
        };
        if parts.len() < 2 || parts.iter().all(|part| self.is_tight(part)) {
            return self.piece(goal);
        }
        let pieces: Vec<_> = parts.iter().map(|part| self.piece(part)).collect();
        pieces.join(&format!(", {} ", first(connective)))
    }

    /// Says a piece; in PDDL if it has no words.
    fn piece(&mut self, condition: &Condition) -> String {
        let words = match condition {
            Condition::And(parts) => self.group(parts, first(&self.book.grammar.and)),
            Condition::Or(parts) => self.group(parts, first(&self.book.grammar.or)),
            Condition::Imply(premise, conclusion) => {
                let (premise, conclusion) = (self.piece(premise), self.piece(conclusion));
                let grammar = &self.book.grammar;
                let (when, then) = (first(&grammar.when), first(&grammar.then));
                Some(format!("{when} {premise} {then} {conclusion}"))
            }
            other => self.unit(other).or_else(|| self.quantified_piece(other)),
        };
        words.unwrap_or_else(|| condition.to_string())
    }

    /// Says units joined by a connective. Units without words are said in PDDL.
    fn group(&mut self, parts: &[Condition], connective: &str) -> Option<String> {
        if parts.len() < 2 {
            return None;
        }
        let said = parts.iter().map(|part| self.unit(part).unwrap_or_else(|| part.to_string()));
        Some(said.collect::<Vec<_>>().join(&format!(" {connective} ")))
    }

    /// Whether a part is joined without a comma: a unit, or PDDL that is not taken apart.
    fn is_tight(&self, part: &Condition) -> bool {
        let is_whole = !matches!(
            part,
            Condition::And(_)
                | Condition::Or(_)
                | Condition::Imply(..)
                | Condition::Forall(..)
                | Condition::Exists(..)
        );
        is_whole || self.unit(part).is_some()
    }

    fn quantified_piece(&mut self, condition: &Condition) -> Option<String> {
        let (quantifier, inner) = Quantifier::of(condition)?;
        let case = GrammaticalCase::Accusative;
        let words = self.book.quantifiers.say(quantifier.is_every, &quantifier.ty(), case);
        self.scope.push(quantifier.variable.clone());
        let inner = self.piece(inner);
        self.scope.pop();
        let before = first(&self.book.grammar.before_quantifier);
        Some(format!("{before} {words} {}: {inner}", quantifier.variable.spelled()))
    }

    /// Says a unit; `None` if it has no words.
    fn unit(&self, condition: &Condition) -> Option<String> {
        if let Some(sentence) = self.sentence(condition) {
            return Some(sentence);
        }
        match condition {
            Condition::Not(inner) => {
                Some(format!("{} {}", first(&self.book.grammar.not), self.unit(inner)?))
            }
            _ => None,
        }
    }

    /// Says a sentence: a phrase or a comparison, with the quantifiers around it at the places of
    /// their variables.
    fn sentence(&self, condition: &Condition) -> Option<String> {
        let (mut quantifiers, mut core) = (Vec::new(), condition);
        while let Some((quantifier, inner)) = Quantifier::of(core) {
            quantifiers.push(quantifier);
            core = inner;
        }
        let mut arguments = Arguments { sayer: self, quantifiers: &quantifiers, named: 0 };
        let said = arguments.core(core)?;
        // A variable that no place has shown would be lost.
        (arguments.named == quantifiers.len()).then_some(said)
    }
}

/// Says the arguments of one sentence, in the order of the text. Each quantifier is said at the only
/// place of its variable, the outermost one first.
struct Arguments<'s, 'g> {
    sayer: &'s Sayer<'s>,
    quantifiers: &'s [Quantifier<'g>],
    /// Number of quantifiers that were said.
    named: usize,
}

// === impl Arguments ===

impl Arguments<'_, '_> {
    fn core(&mut self, core: &Condition) -> Option<String> {
        match core {
            Condition::Atom(atom) => self.atom(atom, PhraseKind::Predicate),
            Condition::Not(inner) => match &**inner {
                Condition::Atom(atom) => self.atom(atom, PhraseKind::Negation),
                _ => None,
            },
            Condition::Equal(one, other, _) => {
                let both = [one.clone(), other.clone()];
                self.phrase(&Name::new("="), PhraseKind::Same, &both)
            }
            Condition::Compare(compare) => self.comparison(compare),
            _ => None,
        }
    }

    fn atom(&mut self, atom: &Atom, kind: PhraseKind) -> Option<String> {
        self.phrase(&atom.predicate, kind, &atom.arguments)
    }

    fn comparison(&mut self, compare: &Compare) -> Option<String> {
        let Expression::Fluent(left) = &compare.left else { return None };
        let said = self.fluent(left)?;
        let words = first(self.sayer.book.comparison(compare.comparison));
        let right = match &compare.right {
            Expression::Number(number) => self.number(*number, &left.function),
            Expression::Fluent(right) => self.fluent(right)?,
            _ => return None,
        };
        Some(format!("{said} {words} {right}"))
    }

    fn fluent(&mut self, fluent: &FluentTerm) -> Option<String> {
        self.phrase(&fluent.function, PhraseKind::Function, &fluent.arguments)
    }

    fn number(&self, number: Number, function: &Name) -> String {
        let book = self.sayer.book;
        let mut said = number.to_string();
        if book.grammar.decimal != '.' {
            said = said.replace('.', &book.grammar.decimal.to_string());
        }
        match book.units(function).first() {
            Some(unit) => format!("{said} {unit}"),
            None => said,
        }
    }

    fn phrase(&mut self, symbol: &Name, kind: PhraseKind, terms: &[Term]) -> Option<String> {
        let pattern: &Pattern = self.sayer.book.said(symbol, kind, terms.len())?;
        let mut words: Vec<String> = Vec::with_capacity(pattern.parts.len());
        for part in &pattern.parts {
            words.push(match part {
                PhrasePart::Word { said, .. } => said.clone(),
                PhrasePart::Place { index, case } => match terms.get(*index)? {
                    Term::Object(name) => name.spelled().to_owned(),
                    Term::Variable(name) => self.variable(name, *case)?,
                },
            });
        }
        Some(words.join(" "))
    }

    /// Says a variable: the next quantifier if that is its own, or its name if it is in scope.
    fn variable(&mut self, name: &Name, case: GrammaticalCase) -> Option<String> {
        let (scope, book) = (&self.sayer.scope, self.sayer.book);
        if !self.quantifiers.iter().any(|quantifier| quantifier.variable == name) {
            return scope.contains(name).then(|| name.spelled().to_owned());
        }
        let next = self.quantifiers.get(self.named).filter(|next| next.variable == name)?;
        let earlier = self.quantifiers[..self.named].iter().map(|one| one.variable);
        let taken: Vec<Name> = scope.iter().chain(earlier).cloned().collect();
        self.named += 1;
        let words = book.quantifiers.say(next.is_every, &next.ty(), case);
        match default_name(&next.ty(), &taken) == *name {
            true => Some(words),
            false => Some(format!("{words} ?{}", name.spelled())),
        }
    }
}

fn first(words: &[String]) -> &str {
    words.first().map_or("", String::as_str)
}
