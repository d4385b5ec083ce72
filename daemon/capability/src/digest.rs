//! Digests of texts: two agents can compare them to find out whether they have the same text, without
//! sending it.
//!
//! If other programs may have to compute a digest too, it is made by FNV-1a with 64 bits, which is
//! defined in four lines and gives the same value in every language and version. Such a digest protects
//! against accidents, not against forgery; the certificates of the substrate protect against that.

use std::hash::{BuildHasher as _, Hash as _, Hasher as _};

use acl::content::{Method, Methods};
use foldhash::fast::FixedState;
use pddl::Problem;

const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;

/// Returns the digest of a text as 16 hexadecimal digits.
pub fn text_digest(text: &str) -> String {
    hex(of_text(text))
}

/// Returns the digest of a text as a number.
pub(crate) fn of_text(text: &str) -> u64 {
    fold(OFFSET, text.as_bytes())
}

/// Returns the digest of a problem, without the goal, for a domain with the digest `domain`. This is much
/// faster than FNV-1a over the problem's text, but only the same build of the program computes the same
/// value.
pub fn problem_digest(domain: &str, problem: &Problem) -> String {
    let mut state = FixedState::with_seed(field(OFFSET, domain)).build_hasher();
    problem.objects.hash(&mut state);
    problem.init.hash(&mut state);
    problem.metric.hash(&mut state);
    hex(state.finish())
}

/// Returns the digest that heartbeats carry: that of an action model's text and its methods.
pub fn model_digest(model: &str, methods: &Methods) -> String {
    hex(methods.iter().fold(field(OFFSET, model), |state, (action, method)| {
        method_into(field(state, action), method)
    }))
}

fn method_into(state: u64, method: &Method) -> u64 {
    let Method { method, arguments, timeout } = method;
    let state = arguments
        .iter()
        .fold(field(state, method), |state, (name, value)| field(field(state, name), value));
    fold(state, &u64::from(*timeout).to_le_bytes())
}

/// Adds a field to a digest. The length of the field is hashed before its bytes, so that two different
/// lists of fields never give the same input.
fn field(state: u64, text: &str) -> u64 {
    fold(fold(state, &(text.len() as u64).to_le_bytes()), text.as_bytes())
}

fn fold(state: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(state, |state, byte| (state ^ u64::from(*byte)).wrapping_mul(PRIME))
}

fn hex(state: u64) -> String {
    format!("{state:016x}")
}

#[cfg(test)]
mod tests {
    use acl::Deadline;

    use super::*;

    fn methods(action: &str, timeout_ms: u64) -> Methods {
        let method = Method {
            method: "navigate_to".to_owned(),
            arguments: [("pose".to_owned(), "?to".to_owned())].into(),
            timeout: Deadline::from(timeout_ms),
        };
        [(action.to_owned(), method)].into()
    }

    #[test]
    fn it_is_the_published_function() {
        // Test vectors of FNV-1a, 64 bits.
        assert_eq!(text_digest(""), "cbf29ce484222325");
        assert_eq!(text_digest("a"), "af63dc4c8601ec8c");
        assert_eq!(text_digest("foobar"), "85944171f73967e8");
    }

    #[test]
    fn methods_count() {
        let digest = model_digest("(define (agent a))", &methods("move", 100));
        assert_eq!(digest, model_digest("(define (agent a))", &methods("move", 100)));
        for other in [methods("mov", 100), methods("move", 200), Methods::new()] {
            assert_ne!(digest, model_digest("(define (agent a))", &other));
        }
    }
}
