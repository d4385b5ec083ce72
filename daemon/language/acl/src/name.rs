//! Names of agents, daemons and ecosystems, which are checked when they are created.
//!
//! Each name is one chunk of a Zenoh key expression, and the name of an agent is also a PDDL
//! object. A name therefore has only characters that both allow. Names are lower case, because PDDL
//! ignores case and Zenoh does not.

use std::borrow::Borrow;
use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

/// Maximum length of a name, in bytes. A key expression has up to six names, and small devices
/// limit its length to 256 bytes.
pub(crate) const NAME_BYTES_MAX: usize = 64;

/// Error for a text that cannot be a name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{name}` cannot be the name of {what}: {rule}")]
pub struct InvalidName {
    /// The text that cannot be a name.
    pub name: String,
    /// Kind of the named element, with its article: `an agent`.
    pub what: &'static str,
    /// The rule for names, as text for a person.
    pub rule: &'static str,
}

const RULE: &str = "use 1 to 64 of `a-z`, `0-9`, `-` and `_`, and begin with a letter";

fn is_name(text: &str) -> bool {
    let rest_is_plain =
        text.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b"-_".contains(&b));
    let begins_with_letter = text.bytes().next().is_some_and(|b| b.is_ascii_lowercase());
    rest_is_plain && begins_with_letter && text.len() <= NAME_BYTES_MAX
}

macro_rules! name_type {
    ($(#[$doc:meta])* $name:ident, $what:literal) => {
        $(#[$doc])*
        #[derive(Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[serde(try_from = "String", into = "String")]
        pub struct $name(Arc<str>);

        impl $name {
            /// Creates a name.
            ///
            /// # Errors
            ///
            /// Returns an error unless `text` has 1 to 64 characters of `a-z`, `0-9`, `-` and `_`,
            /// and begins with a letter.
            pub fn new(text: &str) -> Result<$name, InvalidName> {
                if is_name(text) {
                    return Ok($name(Arc::from(text)));
                }
                Err(InvalidName { name: text.to_owned(), what: $what, rule: RULE })
            }

            /// Returns the name as text.
            pub fn as_str(&self) -> &str {
                &self.0
            }
        }

        #[cfg(test)]
        impl schemars::JsonSchema for $name {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }

            fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
                let pattern = format!("^[a-z][a-z0-9_-]{{0,{}}}$", NAME_BYTES_MAX - 1);
                let about = concat!("The name of ", $what, ".");
                schemars::json_schema!({ "type": "string", "pattern": pattern, "description": about })
            }
        }

        impl TryFrom<String> for $name {
            type Error = InvalidName;

            fn try_from(text: String) -> Result<$name, InvalidName> {
                $name::new(&text)
            }
        }

        impl std::str::FromStr for $name {
            type Err = InvalidName;

            fn from_str(text: &str) -> Result<$name, InvalidName> {
                $name::new(text)
            }
        }

        impl From<$name> for String {
            fn from(name: $name) -> String {
                name.0.as_ref().to_owned()
            }
        }

        impl Borrow<str> for $name {
            fn borrow(&self) -> &str {
                &self.0
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(&self.0)
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                fmt::Debug::fmt(&*self.0, f)
            }
        }
    };
}

name_type! {
    /// Name of an agent: one chunk of a key expression, and a PDDL object.
    AgentId, "an agent"
}
name_type! {
    /// Name of a daemon: one `althing` process.
    DaemonId, "a daemon"
}
/// Separator between the name of a daemon and the role of a guest. A guest is a short-lived process
/// that uses the daemon's key.
const GUEST: &str = "--";

impl DaemonId {
    /// Returns the name of a guest of this daemon. A guest is a short-lived process, such as a
    /// command or a keyboard, that uses the daemon's key.
    ///
    /// # Errors
    ///
    /// Returns an error if the name of the guest would be too long.
    pub fn guest(&self, role: &str) -> Result<DaemonId, InvalidName> {
        DaemonId::new(&format!("{self}{GUEST}{role}"))
    }

    /// Returns the name of the daemon with the key for this name. For a guest, this is the daemon
    /// that it belongs to.
    pub fn host(&self) -> &str {
        self.as_str().split_once(GUEST).map_or(self.as_str(), |(host, _)| host)
    }

    /// Whether this is the name of a guest, and not of a daemon.
    pub fn is_guest(&self) -> bool {
        self.as_str().contains(GUEST)
    }
}

name_type! {
    /// Name of an ecosystem. All agents of the ecosystem share a substrate and a root key
    /// expression.
    EcosystemId, "an ecosystem"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_chunks_and_pddl_objects() {
        for good in ["a", "turtlebot-1", "ir_2", &"x".repeat(64)] {
            assert!(AgentId::new(good).is_ok(), "{good}");
        }
        for bad in
            ["", "1a", "-a", "A", "a/b", "a*", "@a", "a b", "ä", "a.b", "a$b", &"x".repeat(65)]
        {
            assert!(AgentId::new(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn the_name_of_a_guest_contains_its_host() {
        let pi = DaemonId::new("office-pi").expect("a name");
        let guest = pi.guest("cli-7").expect("short");
        assert_eq!(
            (guest.as_str(), guest.host(), guest.is_guest()),
            ("office-pi--cli-7", "office-pi", true)
        );
        assert_eq!((pi.host(), pi.is_guest()), ("office-pi", false));
        assert!(pi.guest(&"x".repeat(60)).is_err());
    }

    #[test]
    fn the_error_explains_valid_names() {
        let error = DaemonId::new("Office Pi").expect_err("a space and capitals");
        assert_eq!(
            error.to_string(),
            "`Office Pi` cannot be the name of a daemon: use 1 to 64 of `a-z`, `0-9`, `-` and `_`, \
             and begin with a letter"
        );
    }
}
