//! The hash function FNV-1a. Its definition has four lines, and it gives the same value in every
//! language, version and run. It is used where several programs or releases must compute the same
//! value. It detects accidental differences, but is no protection against forgery.

const OFFSET_32: u32 = 0x811c_9dc5;
const PRIME_32: u32 = 0x0100_0193;
const OFFSET_64: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME_64: u64 = 0x0000_0100_0000_01b3;

/// Returns the hash of `bytes` with 32 bits.
pub fn hash_32(bytes: &[u8]) -> u32 {
    bytes.iter().fold(OFFSET_32, |hash, byte| (hash ^ u32::from(*byte)).wrapping_mul(PRIME_32))
}

/// The 64-bit hash of all bytes that were added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fnv64(u64);

impl Default for Fnv64 {
    /// Returns the hash of the empty sequence of bytes.
    fn default() -> Fnv64 {
        Fnv64(OFFSET_64)
    }
}

impl Fnv64 {
    /// Adds bytes to the hash.
    #[must_use]
    pub fn with(self, bytes: &[u8]) -> Fnv64 {
        let add = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(PRIME_64);
        Fnv64(bytes.iter().fold(self.0, add))
    }

    /// Returns the value of the hash.
    pub fn value(self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The published test vectors.
    #[test]
    fn the_published_test_vectors_match() {
        for (text, short, long) in [
            ("", 0x811c_9dc5, 0xcbf2_9ce4_8422_2325),
            ("a", 0xe40c_292c, 0xaf63_dc4c_8601_ec8c),
            ("foobar", 0xbf9c_f968, 0x8594_4171_f739_67e8),
        ] {
            assert_eq!(hash_32(text.as_bytes()), short, "{text}");
            assert_eq!(Fnv64::default().with(text.as_bytes()).value(), long, "{text}");
        }
        let parts = Fnv64::default().with(b"foo").with(b"bar");
        assert_eq!(parts, Fnv64::default().with(b"foobar"));
    }
}
