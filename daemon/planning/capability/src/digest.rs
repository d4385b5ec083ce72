//! Digests of texts. By comparing digests, two agents can find out whether they have the same text
//! without sending it.
//!
//! A digest that other programs may have to compute is made by FNV-1a with 64 bits (`acl::fnv`).
//! Such a digest detects accidental differences only. The certificates of the substrate protect
//! against forgery.

use std::hash::{BuildHasher as _, Hash as _, Hasher as _};

use acl::content::{Method, Methods};
use acl::fnv::Fnv64;
use foldhash::fast::FixedState;
use pddl::Problem;

/// Returns the digest of a text as 16 hexadecimal digits.
pub fn text_digest(text: &str) -> String {
    hex(of_text(text))
}

/// Returns the digest of a text as a number.
pub(crate) fn of_text(text: &str) -> u64 {
    Fnv64::default().with(text.as_bytes()).value()
}

/// Returns the digest of a problem without its goal; `domain` is the digest of its domain. The
/// computation is much faster than FNV-1a over the problem's text, but only the same build of the
/// program gives the same value.
pub fn problem_digest(domain: &str, problem: &Problem) -> String {
    let mut state = FixedState::with_seed(field(Fnv64::default(), domain).value()).build_hasher();
    problem.objects.hash(&mut state);
    problem.init.hash(&mut state);
    problem.metric.hash(&mut state);
    hex(state.finish())
}

/// Returns the digest of an action model's text and its methods, which heartbeats carry.
pub fn model_digest(model: &str, methods: &Methods) -> String {
    let model = field(Fnv64::default(), model);
    let whole = methods
        .iter()
        .fold(model, |state, (action, method)| method_into(field(state, action), method));
    hex(whole.value())
}

fn method_into(state: Fnv64, method: &Method) -> Fnv64 {
    let Method { method, arguments, timeout } = method;
    let state = arguments
        .iter()
        .fold(field(state, method), |state, (name, value)| field(field(state, name), value));
    state.with(&u64::from(*timeout).to_le_bytes())
}

/// Adds a field to a digest. The length of the field is hashed before its bytes, so that two
/// different lists of fields never give the same input.
fn field(state: Fnv64, text: &str) -> Fnv64 {
    state.with(&(text.len() as u64).to_le_bytes()).with(text.as_bytes())
}

fn hex(state: u64) -> String {
    format!("{state:016x}")
}

#[cfg(test)]
mod tests {
    use acl::Millis;

    use super::*;

    fn methods(action: &str, timeout_ms: u64) -> Methods {
        let method = Method {
            method: "navigate_to".to_owned(),
            arguments: [("pose".to_owned(), "?to".to_owned())].into(),
            timeout: Millis::from(timeout_ms),
        };
        [(action.to_owned(), method)].into()
    }

    #[test]
    fn a_text_digest_has_sixteen_digits() {
        assert_eq!(text_digest("foobar"), "85944171f73967e8");
    }

    #[test]
    fn methods_are_part_of_the_model_digest() {
        let digest = model_digest("(define (agent a))", &methods("move", 100));
        assert_eq!(digest, model_digest("(define (agent a))", &methods("move", 100)));
        for other in [methods("mov", 100), methods("move", 200), Methods::new()] {
            assert_ne!(digest, model_digest("(define (agent a))", &other));
        }
    }
}
