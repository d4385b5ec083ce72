//! WS-Security of ONVIF: a user name with a digest of the password and of a time (WS-UsernameToken
//! profile 1.1).

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use ring::digest::{Context, SHA1_FOR_LEGACY_USE_ONLY};

use crate::access::CameraLogin;
use crate::xml::escape;

const PROFILE: &str = "http://docs.oasis-open.org/wss/2004/01/oasis-200401-wss";

/// Returns the header `Security` for a request. `created` is the time by the camera's clock, and
/// `nonce` is random.
pub(crate) fn header(login: &CameraLogin, created: &str, nonce: &[u8]) -> String {
    let digest = password_digest(&login.password, created, nonce);
    format!(
        "<wsse:Security s:mustUnderstand=\"true\" \
         xmlns:wsse=\"{PROFILE}-wssecurity-secext-1.0.xsd\" \
         xmlns:wsu=\"{PROFILE}-wssecurity-utility-1.0.xsd\"><wsse:UsernameToken>\
         <wsse:Username>{}</wsse:Username>\
         <wsse:Password Type=\"{PROFILE}-username-token-profile-1.0#PasswordDigest\">{digest}\
         </wsse:Password>\
         <wsse:Nonce EncodingType=\"{PROFILE}-soap-message-security-1.0#Base64Binary\">{}\
         </wsse:Nonce><wsu:Created>{created}</wsu:Created>\
         </wsse:UsernameToken></wsse:Security>",
        escape(&login.user),
        BASE64.encode(nonce)
    )
}

fn password_digest(password: &str, created: &str, nonce: &[u8]) -> String {
    let mut digest = Context::new(&SHA1_FOR_LEGACY_USE_ONLY);
    digest.update(nonce);
    digest.update(created.as_bytes());
    digest.update(password.as_bytes());
    BASE64.encode(digest.finish())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_example_of_the_onvif_guide_has_its_digest() {
        let nonce = BASE64.decode("LKqI6G/AikKCQrN0zqZFlg==").expect("base64");
        let digest = password_digest("userpassword", "2010-09-16T07:50:45Z", &nonce);
        assert_eq!(digest, "tuOSpGlFlIXsozq4HFNeeGeFLEI=");
    }

    #[test]
    fn a_header_has_neither_the_password_nor_raw_markup() {
        let login = CameraLogin { user: "a<b".to_owned(), password: "hunter2".to_owned() };
        let header = header(&login, "2010-09-16T07:50:45Z", b"0123456789abcdef");
        assert!(!header.contains("hunter2") && header.contains("a&lt;b"), "{header}");
        crate::xml::Element::parse(header.as_bytes()).expect("XML, but for a prefix of the whole");
    }
}
