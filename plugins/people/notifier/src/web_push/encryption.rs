//! Encrypts the content of a push message for one browser (RFC 8291, with RFC 8188).

use ring::aead::{AES_128_GCM, Aad, LessSafeKey, Nonce, UnboundKey};
use ring::agreement::{ECDH_P256, EphemeralPrivateKey, UnparsedPublicKey, agree_ephemeral};
use ring::hmac::{HMAC_SHA256, Key, sign};
use ring::rand::{SecureRandom as _, SystemRandom};

/// Length of a public key in uncompressed form, in bytes.
pub(crate) const PUBLIC_KEY_BYTES: usize = 65;

/// Length of the secret by which a browser authenticates messages, in bytes.
pub(crate) const AUTH_BYTES: usize = 16;

const SALT_BYTES: usize = 16;

/// Length of a record in the header: one record has the whole message.
const RECORD_BYTES: u32 = 4_096;

/// Longest content, in bytes: a record without the header, the delimiter and the tag.
const CONTENT_BYTES_MAX: usize = 3_993;

/// Delimiter after the content of the last record.
const LAST_RECORD: u8 = 2;

/// The keys of a subscription, which the browser has made for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct BrowserKeys {
    pub(crate) public: [u8; PUBLIC_KEY_BYTES],
    pub(crate) auth: [u8; AUTH_BYTES],
}

/// Encrypts a content with a new key and a new salt. Errors complete “failed to …”.
pub(crate) fn encrypt(browser: &BrowserKeys, content: &[u8]) -> Result<Vec<u8>, String> {
    let random = SystemRandom::new();
    let unlucky = |_| "get random numbers".to_owned();
    let own = EphemeralPrivateKey::generate(&ECDH_P256, &random).map_err(unlucky)?;
    let own_public = own.compute_public_key().map_err(unlucky)?;
    let mut salt = [0; SALT_BYTES];
    random.fill(&mut salt).map_err(unlucky)?;
    let theirs = UnparsedPublicKey::new(&ECDH_P256, &browser.public);
    let encrypted = agree_ephemeral(own, &theirs, |shared| {
        encrypt_with(browser, shared, own_public.as_ref(), &salt, content)
    });
    encrypted
        .map_err(|_| "use the public key of a subscription, which is none".to_owned())
        .flatten()
}

fn encrypt_with(
    browser: &BrowserKeys,
    shared: &[u8],
    own_public: &[u8],
    salt: &[u8; SALT_BYTES],
    content: &[u8],
) -> Result<Vec<u8>, String> {
    if content.len() > CONTENT_BYTES_MAX {
        return Err(format!("send {} bytes: a push message has fewer", content.len()));
    }
    let info = [b"WebPush: info\0", browser.public.as_slice(), own_public].concat();
    let input = derived(&browser.auth, shared, &info);
    let key = derived(salt, &input, b"Content-Encoding: aes128gcm\0");
    let nonce = derived(salt, &input, b"Content-Encoding: nonce\0");
    let sealed = || {
        let key = LessSafeKey::new(UnboundKey::new(&AES_128_GCM, &key[..16]).ok()?);
        let nonce = Nonce::try_assume_unique_for_key(&nonce[..12]).ok()?;
        let mut record = content.to_vec();
        record.push(LAST_RECORD);
        key.seal_in_place_append_tag(nonce, Aad::empty(), &mut record).ok()?;
        Some(record)
    };
    let record = sealed().ok_or_else(|| "encrypt a push message".to_owned())?;
    let id_length = u8::try_from(own_public.len()).map_err(|error| error.to_string())?;
    let length = RECORD_BYTES.to_be_bytes();
    Ok([salt.as_slice(), &length, &[id_length], own_public, &record].concat())
}

/// Derives 32 bytes (HKDF, RFC 5869, with one block).
fn derived(salt: &[u8], input: &[u8], info: &[u8]) -> [u8; 32] {
    let extracted = sign(&Key::new(HMAC_SHA256, salt), input);
    let expanded = sign(&Key::new(HMAC_SHA256, extracted.as_ref()), &[info, &[1]].concat());
    let mut derived = [0; 32];
    derived.copy_from_slice(expanded.as_ref());
    derived
}

#[cfg(test)]
pub(crate) mod tests {
    use base64::Engine as _;
    use base64::engine::general_purpose::URL_SAFE_NO_PAD;

    use super::*;

    fn bytes<const N: usize>(text: &str) -> [u8; N] {
        let bytes = URL_SAFE_NO_PAD.decode(text).expect("base64");
        bytes.try_into().expect("the length")
    }

    /// The example of RFC 8291, section 5 and appendix A.
    #[test]
    fn the_example_of_the_specification_is_encrypted_alike() {
        let browser = BrowserKeys {
            public: bytes(
                "BCVxsr7N_eNgVRqvHtD0zTZsEc6-VV-JvLexhqUzORcxaOzi6-AYWXvTBHm4bjyPjs7Vd8pZGH6SRpkNto\
                 IAiw4",
            ),
            auth: bytes("BTBZMqHH6r4Tts7J_aSIgg"),
        };
        let shared: [u8; 32] = bytes("kyrL1jIIOHEzg3sM2ZWRHDRB62YACZhhSlknJ672kSs");
        let own: [u8; PUBLIC_KEY_BYTES] = bytes(
            "BP4z9KsN6nGRTbVYI_c7VJSPQTBtkgcy27mlmlMoZIIgDll6e3vCYLocInmYWAmS6TlzAC8wEqKK6PBru3jl7\
             A8",
        );
        let salt = bytes("DGv6ra1nlYgDCS1FRnbzlw");
        let content = b"When I grow up, I want to be a watermelon";
        let encrypted = encrypt_with(&browser, &shared, &own, &salt, content).expect("encrypted");
        assert_eq!(
            URL_SAFE_NO_PAD.encode(encrypted),
            "DGv6ra1nlYgDCS1FRnbzlwAAEABBBP4z9KsN6nGRTbVYI_c7VJSPQTBtkgcy27mlmlMoZIIgDll6e3vCYLocInm\
             YWAmS6TlzAC8wEqKK6PBru3jl7A_yl95bQpu6cVPTpK4Mqgkf1CXztLVBSt2Ks3oZwbuwXPXLWyouBWLVWGNWQe\
             xSgSxsj_Qulcy4a-fN"
        );
    }

    #[test]
    fn a_wrong_key_and_a_long_content_are_refused() {
        let browser = BrowserKeys { public: [4; PUBLIC_KEY_BYTES], auth: [0; AUTH_BYTES] };
        assert!(encrypt(&browser, b"a").expect_err("no point").contains("public key"));
        let content = vec![0; CONTENT_BYTES_MAX + 1];
        let refused = encrypt_with(&browser, &[1; 32], &[4; 65], &[0; 16], &content);
        assert!(refused.expect_err("too long").contains("3994 bytes"));
    }
}
