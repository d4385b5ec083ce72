//! Passwords: what a new one has to be, and the argon2id hashes under which they are kept.

use std::fmt;

use argon2::password_hash::{PasswordHash, PasswordHasher as _, PasswordVerifier as _, SaltString};
use argon2::{Algorithm, Argon2, Params, Version};

use crate::error::AccountsError;
use crate::secret::random;

/// Minimum length of a new password, in characters. Attempts are limited in their rate, and a stolen
/// file costs an attacker the time of a hash for each guess.
pub const PASSWORD_CHARS_MIN: usize = 10;

/// Maximum length of a password, in bytes. A hash reads all of them, and no person types more.
pub const PASSWORD_BYTES_MAX: usize = 1_024;

/// Minimum number of different characters of a new password: `aaaaaaaaaa` is the first guess.
const DIFFERENT_CHARS_MIN: usize = 5;

/// Length of a salt, in bytes, as RFC 9106 recommends.
const SALT_BYTES: usize = 16;

/// Length of a hash, in bytes. A shorter one is refused: it was cut.
const HASH_BYTES: usize = 32;

/// Memory, passes and lanes beyond which a hash of a file is not computed: a wrong file must not take
/// all memory of a board.
const COST_MAX: PasswordCost = PasswordCost { memory_kib: 256 << 10, passes: 16 };
const LANES_MAX: u32 = 4;

/// The cost of one computation of a hash: for the daemon, and of each guess of an attacker with the
/// file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct PasswordCost {
    memory_kib: u32,
    passes: u32,
}

/// The argon2id hash of a password, as a PHC string: `$argon2id$v=19$m=…,t=…,p=…$SALT$HASH`.
#[derive(Clone, PartialEq, Eq)]
pub struct StoredPassword {
    phc: String,
    cost: PasswordCost,
}

/// Returns an error if a new password is too short, too long, or too easily guessed.
///
/// # Errors
///
/// Returns [`AccountsError::Password`] with what is missing.
pub fn check_new_password(name: &str, password: &str) -> Result<(), AccountsError> {
    let length = password.chars().count();
    let mut different: Vec<char> = password.chars().collect();
    different.sort_unstable();
    different.dedup();
    let problem = if length < PASSWORD_CHARS_MIN {
        "it is too short; a password has at least 10 characters"
    } else if password.len() > PASSWORD_BYTES_MAX {
        "it is too long; a password has at most 1,024 bytes"
    } else if different.len() < DIFFERENT_CHARS_MIN {
        "it repeats itself; a password has at least 5 different characters"
    } else if password.to_lowercase().contains(&name.to_lowercase()) && length < 2 * name.len() {
        "it is little more than the name; choose another"
    } else if password.chars().any(char::is_control) {
        "it has a control character, which no keyboard types twice alike"
    } else {
        return Ok(());
    };
    Err(AccountsError::Password(problem))
}

/// Returns a password that a program has chosen: 20 letters and digits in groups of five, with 100
/// random bits. Letters and digits that look alike are left out.
///
/// # Errors
///
/// Returns an error if the system gives no random bytes.
pub fn generate_password() -> Result<String, AccountsError> {
    const LETTERS: &[u8; 32] = b"abcdefghijkmnpqrstuvwxyz23456789";
    let bytes = random::<20>()?;
    let mut password = String::with_capacity(23);
    for (at, byte) in bytes.iter().enumerate() {
        if at > 0 && at % 5 == 0 {
            password.push('-');
        }
        password.push(char::from(LETTERS[usize::from(byte % 32)]));
    }
    Ok(password)
}

// === impl PasswordCost ===

impl PasswordCost {
    /// The cost of new hashes: 19 MiB, two passes, one lane. OWASP recommends these parameters as the
    /// least of argon2id. More memory would keep a board with 512 MiB from checking two passwords at
    /// a time beside its daemon.
    pub const RECOMMENDED: PasswordCost = PasswordCost { memory_kib: 19 << 10, passes: 2 };

    /// The least cost that argon2id allows. Only for tests, which would otherwise measure argon2.
    pub const FOR_TESTS: PasswordCost = PasswordCost { memory_kib: 8, passes: 1 };

    fn argon2(self, lanes: u32) -> Result<Argon2<'static>, AccountsError> {
        let params = Params::new(self.memory_kib, self.passes, lanes, Some(HASH_BYTES));
        let params = params.map_err(|error| AccountsError::Secret(error.to_string()))?;
        Ok(Argon2::new(Algorithm::Argon2id, Version::V0x13, params))
    }
}

// === impl StoredPassword ===

impl StoredPassword {
    /// Returns the hash of a password, with a new salt.
    ///
    /// # Errors
    ///
    /// Returns an error if the system gives no random bytes or no memory.
    pub fn hash(password: &str, cost: PasswordCost) -> Result<StoredPassword, AccountsError> {
        let failed = |error: argon2::password_hash::Error| AccountsError::Secret(error.to_string());
        let salt = SaltString::encode_b64(&random::<SALT_BYTES>()?).map_err(failed)?;
        let phc = cost.argon2(1)?.hash_password(password.as_bytes(), &salt).map_err(failed)?;
        Ok(StoredPassword { phc: phc.to_string(), cost })
    }

    /// Returns the hash that a text of a file is. The error text says what is wrong with it, and does
    /// not quote it: it could be a password.
    pub(crate) fn parse(text: &str) -> Result<StoredPassword, &'static str> {
        let hash = PasswordHash::new(text).map_err(|_| "it is no hash of a password")?;
        if hash.algorithm.as_str() != "argon2id" {
            return Err("it is a hash of another kind than argon2id");
        }
        if hash.version != Some(u32::from(Version::V0x13)) {
            return Err("it is a hash of another version of argon2id than 19");
        }
        if hash.salt.is_none() || hash.hash.is_none_or(|hash| hash.len() < HASH_BYTES) {
            return Err("its salt or its end is missing");
        }
        let params =
            Params::try_from(&hash).map_err(|_| "its parameters are not those of argon2id")?;
        let cost = PasswordCost { memory_kib: params.m_cost(), passes: params.t_cost() };
        let is_within = cost.memory_kib <= COST_MAX.memory_kib && cost.passes <= COST_MAX.passes;
        if !is_within || params.p_cost() > LANES_MAX {
            return Err("checking it would take more than 256 MiB, 16 passes or 4 lanes");
        }
        Ok(StoredPassword { phc: text.to_owned(), cost })
    }

    /// Whether `password` is the password of this hash. Takes tens of milliseconds, and blocks.
    pub(crate) fn is_of(&self, password: &str) -> bool {
        let Ok(hash) = PasswordHash::new(&self.phc) else { return false };
        Argon2::default().verify_password(password.as_bytes(), &hash).is_ok()
    }

    /// Returns the text of the hash, for a file.
    pub(crate) fn as_str(&self) -> &str {
        &self.phc
    }

    /// Returns what a check of the password costs.
    pub(crate) fn cost(&self) -> PasswordCost {
        self.cost
    }

    /// Whether the hash is cheaper to guess than a new one would be.
    pub(crate) fn is_weak(&self) -> bool {
        let PasswordCost { memory_kib, passes } = self.cost;
        let work = |cost: PasswordCost| u64::from(cost.memory_kib) * u64::from(cost.passes);
        work(PasswordCost { memory_kib, passes }) < work(PasswordCost::RECOMMENDED)
    }
}

impl fmt::Debug for StoredPassword {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("StoredPassword(…)")
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    fn stored(password: &str) -> StoredPassword {
        StoredPassword::hash(password, PasswordCost::FOR_TESTS).expect("memory")
    }

    #[test]
    fn a_hash_is_of_its_password_and_no_other() {
        let hash = stored("a long password");
        assert!(hash.is_of("a long password"));
        for wrong in ["", "a long passwor", "a long password ", "A long password"] {
            assert!(!hash.is_of(wrong), "{wrong}");
        }
        assert_ne!(hash, stored("a long password"), "each has a salt of its own");
        assert!(!format!("{hash:?}").contains("argon2id"));
    }

    #[test]
    fn a_new_hash_has_the_recommended_cost_and_is_read_again() {
        let hash = StoredPassword::hash("a long password", PasswordCost::RECOMMENDED);
        let hash = hash.expect("memory");
        assert!(hash.as_str().starts_with("$argon2id$v=19$m=19456,t=2,p=1$"), "{}", hash.as_str());
        let read = StoredPassword::parse(hash.as_str()).expect("a hash");
        assert_eq!(read, hash);
        assert_eq!(read.cost(), PasswordCost::RECOMMENDED);
        assert!(!read.is_weak() && read.is_of("a long password"));
        assert!(stored("a long password").is_weak());
    }

    #[test]
    fn what_is_no_hash_is_refused_and_not_quoted() {
        let good = stored("a long password");
        let good = good.as_str();
        for wrong in [
            "",
            "a long password",
            "$argon2id$v=19$m=8,t=1,p=1",
            &good.replace("argon2id", "argon2i"),
            &good.replace("v=19", "v=16"),
            &good.replace("m=8", "m=4000000"),
            &good.replace("t=1", "t=4000000"),
            &good.replace("p=1", "p=200"),
            &good[..good.len() - 20],
            &good[..good.len() - 1],
            &format!("{good}\0"),
        ] {
            let error = StoredPassword::parse(wrong).expect_err(wrong);
            assert!(wrong.is_empty() || !error.contains(wrong), "{error}");
        }
        assert!(StoredPassword::parse(good).is_ok());
    }

    #[test]
    fn new_passwords_are_judged() {
        for good in ["correct horse", "zwölf Bären", "p4ssw0rd-für-anna"] {
            check_new_password("anna", good).expect(good);
        }
        let long = "abcdefgh".repeat(200);
        for bad in ["", "short", "aaaaaaaaaaaa", "abababababab", "with\u{1b}escape", &long] {
            assert!(check_new_password("anna", bad).is_err(), "{bad:?}");
        }
        assert!(check_new_password("annabella-maria", "Annabella-Maria1").is_err());
    }

    #[test]
    fn generated_passwords_are_accepted_and_differ() {
        let all: BTreeSet<_> =
            (0..100).map(|_| generate_password().expect("random bytes")).collect();
        assert_eq!(all.len(), 100);
        for password in &all {
            assert_eq!(password.len(), 23);
            check_new_password("anna", password).expect(password);
        }
    }
}
