//! Webhooks: a `POST` of JSON, signed as *Standard Webhooks* (standardwebhooks.com) defines it, so
//! that a receiver can check with a library of any language that a notice is from here, and new.

use std::time::{SystemTime, UNIX_EPOCH};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use ring::hmac::{HMAC_SHA256, Key, sign};

use crate::address::ReceiverAddress;
use crate::channel_secret::ChannelSecret;
use crate::http::{PostRequest, post};
use crate::notice::NoticeDelivery;
use crate::send_failure::SendFailure;
use crate::sentences::NoticeForm;
use crate::trust::ReceiverTrust;

/// Beginning of a secret in its file.
const SECRET_PREFIX: &str = "whsec_";

/// Lengths of a key, in bytes, as the specification has them.
const KEY_BYTES: std::ops::RangeInclusive<usize> = 24..=64;

/// A program that takes JSON by HTTP.
pub(crate) struct Webhook {
    address: ReceiverAddress,
    trust: ReceiverTrust,
    key: Key,
}

// === impl Webhook ===

impl Webhook {
    /// Creates a webhook. The secret is `whsec_` and the key in base64.
    ///
    /// # Errors
    ///
    /// Returns the reason as a text for a person, which does not repeat the secret.
    pub(crate) fn new(
        address: ReceiverAddress,
        trust: ReceiverTrust,
        secret: &ChannelSecret,
    ) -> Result<Webhook, String> {
        let key = secret.reveal().strip_prefix(SECRET_PREFIX);
        let key = key.and_then(|key| STANDARD.decode(key).ok());
        let key = key.filter(|key| KEY_BYTES.contains(&key.len())).ok_or_else(|| {
            "the secret must be `whsec_` and 24 to 64 random bytes in base64; make one with \
             `echo whsec_$(head -c 32 /dev/urandom | base64)`"
                .to_owned()
        })?;
        Ok(Webhook { address, trust, key: Key::new(HMAC_SHA256, &key) })
    }

    /// Sends a delivery once.
    pub(crate) async fn send(
        &self,
        delivery: &NoticeDelivery,
        form: &NoticeForm,
    ) -> Result<(), SendFailure> {
        let body = form.json(delivery).to_string();
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let timestamp = since.as_secs();
        let signature = self.signature(&delivery.id, timestamp, &body);
        let headers = vec![
            ("Content-Type", "application/json".to_owned()),
            ("Webhook-Id", delivery.id.clone()),
            ("Webhook-Timestamp", timestamp.to_string()),
            ("Webhook-Signature", signature),
        ];
        let (address, trust) = (&self.address, &self.trust);
        post(PostRequest { address, trust, headers, body: body.into_bytes() }).await?.judge()
    }

    fn signature(&self, id: &str, timestamp: u64, body: &str) -> String {
        let signed = format!("{id}.{timestamp}.{body}");
        let signature = sign(&self.key, signed.as_bytes());
        format!("v1,{}", STANDARD.encode(signature.as_ref()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn webhook(secret: &str) -> Result<Webhook, String> {
        let address = ReceiverAddress::parse("http://localhost:1").expect("an address");
        Webhook::new(address, ReceiverTrust::Machine, &ChannelSecret::of(secret))
    }

    /// The example of the specification and of its libraries.
    #[test]
    fn the_signature_is_that_of_the_specification() {
        let webhook = webhook("whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw").expect("a secret");
        let id = "msg_p5jXN8AQM9LWM0D4loKWxJek";
        let signature = webhook.signature(id, 1_614_265_330, "{\"test\": 2432232314}");
        assert_eq!(signature, "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
    }

    #[test]
    fn a_secret_that_is_none_is_refused_without_repeating_it() {
        for wrong in ["MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw", "whsec_c2hvcnQ=", "whsec_!"] {
            let why = webhook(wrong).err().expect(wrong);
            assert!(why.contains("urandom") && !why.contains("MfKQ"), "{why}");
        }
        assert!(webhook(ChannelSecret::unread().reveal()).is_ok());
    }
}
