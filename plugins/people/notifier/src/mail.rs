//! E-mail through a relay (SMTP). The connection is encrypted, unless the relay is on this machine.

use std::path::Path;
use std::time::Duration;

use lettre::message::header::{ContentType, HeaderName, HeaderValue};
use lettre::message::{Mailbox, Message};
use lettre::transport::smtp::authentication::Credentials;
use lettre::transport::smtp::client::{Certificate, CertificateStore, Tls, TlsParameters};
use lettre::{AsyncSmtpTransport, AsyncTransport as _, Tokio1Executor};

use crate::address::is_loopback;
use crate::channel_secret::ChannelSecret;
use crate::notice::NoticeDelivery;
use crate::send_failure::SendFailure;
use crate::sentences::NoticeForm;
use crate::trust::ReceiverTrust;

/// Time limit of each command of SMTP.
const COMMAND_WITHIN: Duration = Duration::from_secs(10);

/// Time limit of one message with the connection, which takes about ten commands.
const SENT_WITHIN: Duration = Duration::from_secs(60);

/// Encryption of the connection to a relay.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum MailSecurity {
    /// TLS from the first byte; usually at port 465.
    Tls,
    /// TLS after the command `STARTTLS`, without which nothing is sent; usually at port 587.
    Starttls,
    /// No encryption, for a relay on this machine; usually at port 25.
    None,
}

/// Addresses behind a mail relay.
pub(crate) struct MailRelay {
    host: String,
    port: u16,
    security: MailSecurity,
    trust: ReceiverTrust,
    /// User and password, if the relay asks for them.
    login: Option<(String, ChannelSecret)>,
    from: Mailbox,
    to: Vec<Mailbox>,
}

// === impl MailSecurity ===

impl MailSecurity {
    /// Returns the usual port.
    pub(crate) fn port(self) -> u16 {
        match self {
            MailSecurity::Tls => 465,
            MailSecurity::Starttls => 587,
            MailSecurity::None => 25,
        }
    }
}

// === impl MailRelay ===

impl MailRelay {
    /// Creates a relay.
    ///
    /// # Errors
    ///
    /// Returns the reason as a text for a person.
    pub(crate) fn new(
        (host, port): (String, u16),
        (security, trust): (MailSecurity, ReceiverTrust),
        login: Option<(String, ChannelSecret)>,
        (from, to): (&str, &[String]),
    ) -> Result<MailRelay, String> {
        if security == MailSecurity::None && !is_loopback(&host) {
            return Err("`security = \"none\"` is for a relay on this machine only, because \
                        everyone on the network could read it; write \"tls\" or \"starttls\""
                .to_owned());
        }
        if security == MailSecurity::None && login.is_some() {
            return Err("a password is sent only over an encrypted connection".to_owned());
        }
        let mailbox = |text: &str| {
            let parsed = text.parse::<Mailbox>();
            let parsed = parsed.map_err(|_| {
                format!(
                    "`{text}` is no address of e-mail; write \"caretaker@example.org\" or \
                     \"Caretaker <caretaker@example.org>\""
                )
            })?;
            match parsed.email.to_string().is_ascii() {
                true => Ok(parsed),
                false => {
                    Err(format!("`{text}`: an address is ASCII; its name may be in any script"))
                }
            }
        };
        let to = to.iter().map(|to| mailbox(to)).collect::<Result<Vec<_>, _>>()?;
        Ok(MailRelay { host, port, security, trust, login, from: mailbox(from)?, to })
    }

    /// Sends a delivery once.
    pub(crate) async fn send(
        &self,
        delivery: &NoticeDelivery,
        form: &NoticeForm,
    ) -> Result<(), SendFailure> {
        let message = self.message(delivery, form);
        let message =
            message.map_err(|error| SendFailure::Never(format!("write the message: {error}")))?;
        let transport = self.transport().await?;
        let sent = tokio::time::timeout(SENT_WITHIN, transport.send(message)).await;
        let relay = &self.host;
        match sent {
            Err(_) => Err(SendFailure::later(format!("send it within {SENT_WITHIN:?}"))),
            Ok(Ok(_)) => Ok(()),
            // The answer could repeat the message, so that only its code is told.
            Ok(Err(error)) => match error.status() {
                Some(code) if error.is_permanent() => {
                    Err(SendFailure::Never(format!("be taken by {relay}: SMTP {code}")))
                }
                Some(code) => {
                    Err(SendFailure::later(format!("be taken by {relay} now: SMTP {code}")))
                }
                None => Err(SendFailure::later(format!("reach {relay}: {}", causes(&error)))),
            },
        }
    }

    fn message(
        &self,
        delivery: &NoticeDelivery,
        form: &NoticeForm,
    ) -> Result<Message, lettre::error::Error> {
        let host = form.ecosystem.as_str();
        let subject = format!("[{host}] {}", form.title(delivery));
        let mut text = form.text(delivery);
        if let Some(link) = form.link(delivery) {
            text.push_str(&format!("\n\n{link}\n"));
        }
        let automatic = HeaderName::new_from_ascii_str("Auto-Submitted");
        let mut message = Message::builder()
            .from(self.from.clone())
            .subject(subject)
            .date_now()
            // The same in each attempt, so that programs of e-mail show a repeated one once.
            .message_id(Some(format!("<{}@{host}.althing>", delivery.id)))
            .raw_header(HeaderValue::new(automatic, "auto-generated".to_owned()))
            .header(ContentType::TEXT_PLAIN);
        for to in &self.to {
            message = message.to(to.clone());
        }
        message.body(text)
    }

    async fn transport(&self) -> Result<AsyncSmtpTransport<Tokio1Executor>, SendFailure> {
        let tls = match self.security {
            MailSecurity::None => Tls::None,
            MailSecurity::Tls => Tls::Wrapper(self.parameters().await?),
            MailSecurity::Starttls => Tls::Required(self.parameters().await?),
        };
        let mut transport =
            AsyncSmtpTransport::<Tokio1Executor>::builder_dangerous(self.host.as_str())
                .port(self.port)
                .timeout(Some(COMMAND_WITHIN))
                .tls(tls);
        if let Some((user, password)) = &self.login {
            let password = password.reveal().to_owned();
            transport = transport.credentials(Credentials::new(user.clone(), password));
        }
        Ok(transport.build())
    }

    async fn parameters(&self) -> Result<TlsParameters, SendFailure> {
        let (host, trust) = (self.host.clone(), self.trust.clone());
        let built = tokio::task::spawn_blocking(move || parameters(host, &trust)).await;
        built.map_err(|error| error.to_string()).flatten().map_err(SendFailure::later)
    }
}

fn parameters(host: String, trust: &ReceiverTrust) -> Result<TlsParameters, String> {
    let mut parameters = TlsParameters::builder(host);
    if let ReceiverTrust::File(file) = trust {
        parameters = parameters.certificate_store(CertificateStore::None);
        parameters = parameters.add_root_certificate(certificate(file)?);
    }
    parameters.build_rustls().map_err(|error| format!("use TLS: {error}"))
}

fn certificate(file: &Path) -> Result<Certificate, String> {
    let shown = file.display();
    let pem = std::fs::read(file).map_err(|error| format!("read {shown}: {error}"))?;
    Certificate::from_pem(&pem).map_err(|error| format!("use {shown}: {error}"))
}

/// Returns the text of an error with its causes, which the library leaves out.
fn causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text.push_str(&format!(": {error}"));
        cause = error.source();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::notice::{Notice, NoticeKind};

    fn relay(host: &str, security: MailSecurity, to: &str) -> Result<MailRelay, String> {
        let trust = ReceiverTrust::Machine;
        let to = [to.to_owned()];
        MailRelay::new((host.to_owned(), 25), (security, trust), None, ("a@b.example", &to))
    }

    #[test]
    fn an_unencrypted_relay_is_on_this_machine() {
        assert!(relay("localhost", MailSecurity::None, "c@d.example").is_ok());
        let why = relay("mail.example", MailSecurity::None, "c@d.example").err().expect("refused");
        assert!(why.contains("\"starttls\""), "{why}");
        let why = relay("localhost", MailSecurity::None, "nobody").err().expect("refused");
        assert!(why.contains("`nobody` is no address"), "{why}");
        assert!(relay("localhost", MailSecurity::None, "Jörg <j@d.example>").is_ok());
        for address in ["jörg@d.example", "j@bücher.example", "j@\u{202e}a.example"] {
            let why = relay("localhost", MailSecurity::None, address).err().expect("refused");
            assert!(why.contains("address"), "{why}");
        }
    }

    /// A text with line breaks adds no header, and letters beyond ASCII arrive.
    #[test]
    fn a_message_has_the_headers_of_the_notice_and_no_others() {
        let relay = relay("localhost", MailSecurity::None, "Ann <c@d.example>").expect("a relay");
        let notice = Notice::new(NoticeKind::Stop, "s", 1);
        let notice = notice.with_text("fire\r\nBcc: x@y.example\r\n\r\nalärm");
        let delivery = NoticeDelivery { id: "7f".to_owned(), notices: vec![notice] };
        let form = NoticeForm { ecosystem: "lab".to_owned(), ..NoticeForm::default() };
        let message = relay.message(&delivery, &form).expect("a message");
        let text = String::from_utf8(message.formatted()).expect("text");
        assert!(text.contains("Subject: [lab] Stop\r\n"), "{text}");
        assert!(text.contains("Message-ID: <7f@lab.althing>\r\n"), "{text}");
        assert!(text.contains("Auto-Submitted: auto-generated\r\n"), "{text}");
        assert!(!text.contains("\r\nBcc"), "{text}");
    }
}
