//! The people of an ecosystem: rights, passwords, sessions, tokens of programs, and a log of what
//! people ask for.
//!
//! - [`PeopleFile`] is the file `people.toml`, with hashes and without passwords; [`PeopleRecords`]
//!   is its content, [`read_people`] reads it with all mistakes at their places.
//! - [`Accounts`] is what a daemon needs: it signs people in, within limits of attempts, and keeps
//!   their sessions in memory.
//! - A screen of an agent stands among the people, without rights and without a password: it has a
//!   token, and the name of its agent.
//! - [`RequestLog`] keeps the requests of people, with the address of each.
//!
//! Which right a request needs is decided by the server of the page, and what a daemon may request
//! by the rights of the ecosystem; this crate knows neither.

mod accounts;
mod attempts;
mod error;
mod file_text;
mod password;
mod people_file;
mod person_name;
mod records;
mod request_log;
mod right;
mod secret;
mod sessions;

pub use accounts::Accounts;
pub use error::{AccountsError, SignInRefusal};
pub use file_text::{PeopleText, read_people, without_secrets};
pub use password::{
    PASSWORD_BYTES_MAX, PASSWORD_CHARS_MIN, PasswordCost, StoredPassword, check_new_password,
    generate_password,
};
pub use people_file::PeopleFile;
pub use person_name::{NAME_BYTES_MAX, PersonName, PersonNameError};
pub use records::{PEOPLE_MAX, PeopleRecords, PersonRecord, StoredToken, TOKENS_MAX};
pub use request_log::{LoggedRequest, RequestLog};
pub use right::{Person, PersonRight, PersonRole};
pub use secret::SecretDigest;
pub use sessions::{NewSession, SESSION_IDLE_MAX, SESSION_LASTS, SignedIn};

#[cfg(test)]
mod tests;
