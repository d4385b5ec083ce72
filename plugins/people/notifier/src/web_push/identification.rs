//! Proves to push services that messages come from this notifier (VAPID, RFC 8292).

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use ring::rand::SystemRandom;
use ring::signature::{ECDSA_P256_SHA256_FIXED_SIGNING, EcdsaKeyPair, KeyPair as _};
use serde_json::json;

/// Time for which a proof holds, in seconds. At most a day is allowed.
const VALID_SECONDS: u64 = 12 * 3_600;

/// The key of a notifier. Subscriptions hold for this key only.
#[derive(Debug)]
pub(crate) struct PushIdentity {
    pair: EcdsaKeyPair,
    public: String,
}

// === impl PushIdentity ===

impl PushIdentity {
    /// Makes a new key, as text for a file. Errors complete “failed to …”.
    pub(crate) fn generate() -> Result<String, String> {
        let random = SystemRandom::new();
        let key = EcdsaKeyPair::generate_pkcs8(&ECDSA_P256_SHA256_FIXED_SIGNING, &random);
        let key = key.map_err(|_| "make a key".to_owned())?;
        Ok(URL_SAFE_NO_PAD.encode(key.as_ref()))
    }

    /// Reads a key. Errors complete “failed to …”, and do not repeat the key.
    pub(crate) fn parse(text: &str) -> Result<PushIdentity, String> {
        let key = URL_SAFE_NO_PAD.decode(text.trim()).ok();
        let random = SystemRandom::new();
        let pair = key.and_then(|key| {
            EcdsaKeyPair::from_pkcs8(&ECDSA_P256_SHA256_FIXED_SIGNING, &key, &random).ok()
        });
        let pair = pair.ok_or_else(|| "use the key: it is none".to_owned())?;
        let public = URL_SAFE_NO_PAD.encode(pair.public_key().as_ref());
        Ok(PushIdentity { pair, public })
    }

    /// Returns the public key, as browsers take it.
    pub(crate) fn public(&self) -> &str {
        &self.public
    }

    /// Returns the value of the header `Authorization` for a push service. Errors complete
    /// “failed to …”.
    pub(crate) fn authorization(
        &self,
        audience: &str,
        contact: &str,
        now_seconds: u64,
    ) -> Result<String, String> {
        let part = |value: serde_json::Value| URL_SAFE_NO_PAD.encode(value.to_string());
        let header = part(json!({ "typ": "JWT", "alg": "ES256" }));
        let ends = now_seconds.saturating_add(VALID_SECONDS);
        let claims = part(json!({ "aud": audience, "exp": ends, "sub": contact }));
        let signed = format!("{header}.{claims}");
        let signature = self.pair.sign(&SystemRandom::new(), signed.as_bytes());
        let signature = signature.map_err(|_| "sign for the push service".to_owned())?;
        let signature = URL_SAFE_NO_PAD.encode(signature.as_ref());
        Ok(format!("vapid t={signed}.{signature}, k={}", self.public))
    }
}

#[cfg(test)]
mod tests {
    use ring::signature::{ECDSA_P256_SHA256_FIXED, UnparsedPublicKey};

    use super::*;

    #[test]
    fn a_proof_is_a_signed_token_for_one_service() {
        let key = PushIdentity::generate().expect("a key");
        let identity = PushIdentity::parse(&format!("{key}\n")).expect("the key");
        let said = identity.authorization("https://push.example", "mailto:a@b.example", 1_000);
        let said = said.expect("signed");
        let rest = said.strip_prefix("vapid t=").expect("the scheme");
        let (token, public) = rest.split_once(", k=").expect("two parts");
        let (signed, signature) = token.rsplit_once('.').expect("three parts");
        let decode = |text: &str| URL_SAFE_NO_PAD.decode(text).expect("base64");
        let claims = signed.split_once('.').expect("two parts").1;
        let claims: serde_json::Value = serde_json::from_slice(&decode(claims)).expect("JSON");
        let wanted = json!({
            "aud": "https://push.example", "exp": 44_200, "sub": "mailto:a@b.example",
        });
        assert_eq!(claims, wanted);
        let public = UnparsedPublicKey::new(&ECDSA_P256_SHA256_FIXED, decode(public));
        public.verify(signed.as_bytes(), &decode(signature)).expect("the signature holds");
    }

    #[test]
    fn a_wrong_key_is_refused_without_repeating_it() {
        let why = PushIdentity::parse("AAAA").expect_err("no key");
        assert!(!why.contains("AAAA"), "{why}");
    }
}
