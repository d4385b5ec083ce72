//! Envelopes of SOAP 1.2, and faults of SOAP 1.1 and 1.2.

use std::fmt::Write as _;

use crate::error::excerpt;
use crate::xml::{Element, escape};

const ENVELOPE: &str = "http://www.w3.org/2003/05/soap-envelope";
const ADDRESSING: &str = "http://www.w3.org/2005/08/addressing";

/// An operation of a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Operation<'o> {
    /// Namespace of the service.
    pub(crate) namespace: &'o str,
    /// Name of the operation.
    pub(crate) name: &'o str,
    /// Identifier of the operation in the header `Action`.
    pub(crate) action: &'o str,
}

/// Header of WS-Addressing, which subscriptions need.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Addressing<'a> {
    /// Address to which the request goes, as the camera has named it.
    pub(crate) to: &'a str,
    /// Further headers that the camera asked for when it named the address.
    pub(crate) parameters: &'a [Element],
}

/// Returns the text of a request. `content` is the XML inside the element of the operation, in
/// which the prefix `o` stands for the service's namespace and `tt` for that of common types.
pub(crate) fn envelope(
    operation: Operation<'_>,
    content: &str,
    security: &str,
    addressing: Option<&Addressing<'_>>,
) -> String {
    let Operation { namespace, name, action } = operation;
    let mut header = security.to_owned();
    if let Some(Addressing { to, parameters }) = addressing {
        // Writing to memory cannot fail.
        let _ = write!(
            header,
            "<a:Action s:mustUnderstand=\"true\">{action}</a:Action>\
             <a:ReplyTo><a:Address>{ADDRESSING}/anonymous</a:Address></a:ReplyTo>\
             <a:To s:mustUnderstand=\"true\">{}</a:To>",
            escape(to)
        );
        for parameter in *parameters {
            write_parameter(&mut header, parameter, true);
        }
    }
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\
         <s:Envelope xmlns:s=\"{ENVELOPE}\" xmlns:a=\"{ADDRESSING}\">\
         <s:Header>{header}</s:Header><s:Body><o:{name} xmlns:o=\"{namespace}\" \
         xmlns:tt=\"http://www.onvif.org/ver10/schema\">{content}</o:{name}></s:Body></s:Envelope>"
    )
}

/// Writes an element of a reference to a subscription as a header, as the camera requires it in
/// requests about the subscription.
fn write_parameter(header: &mut String, element: &Element, is_header: bool) {
    let Element { name, namespace, .. } = element;
    // A name that is no name would spoil the request; such an element is left out.
    if !name.chars().all(|symbol| symbol.is_alphanumeric() || "-_.".contains(symbol)) {
        return;
    }
    let mark = if is_header { " a:IsReferenceParameter=\"true\"" } else { "" };
    let _ = write!(header, "<p:{name} xmlns:p=\"{}\"{mark}>", escape(namespace));
    header.push_str(&escape(element.text()));
    for child in &element.children {
        write_parameter(header, child, false);
    }
    let _ = write!(header, "</p:{name}>");
}

/// A fault with which a camera answers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct SoapFault {
    /// Codes of the fault, without prefixes, the general one first.
    codes: Vec<String>,
    /// Reason for people, with the last code.
    pub(crate) reason: String,
}

impl SoapFault {
    /// Whether the camera rejects the login.
    pub(crate) fn is_login_rejected(&self) -> bool {
        let codes = ["NotAuthorized", "FailedAuthentication", "InvalidSecurity", "MessageExpired"];
        self.codes.iter().any(|code| {
            codes.iter().any(|known| code.contains(known)) || code.contains("SecurityToken")
        }) || self.reason.to_ascii_lowercase().contains("not authorized")
    }

    /// Whether the camera does not have the operation.
    pub(crate) fn is_unsupported(&self) -> bool {
        let known = ["ActionNotSupported", "OptionalActionNotImplemented", "UnknownAction"];
        self.codes.iter().any(|code| known.contains(&code.as_str()))
    }
}

/// Returns the content of the body of an answer, or the fault in it. Returns an error if the answer
/// is no envelope.
pub(crate) fn open(answer: &Element) -> Result<Result<Element, SoapFault>, String> {
    let body = match answer.name.as_str() {
        "Envelope" => answer.child("Body").ok_or("it has no body")?,
        other => return Err(format!("it is <{}>, and no envelope", excerpt(other))),
    };
    if let Some(fault) = body.child("Fault") {
        return Ok(Err(fault_of(fault)));
    }
    let content = body.children.first().cloned();
    content.map(Ok).ok_or_else(|| "its body is empty".to_owned())
}

fn fault_of(fault: &Element) -> SoapFault {
    let mut codes = Vec::new();
    let mut code = fault.child("Code");
    while let Some(element) = code {
        codes.extend(element.text_at(&["Value"]).map(local));
        code = element.child("Subcode");
    }
    codes.extend(fault.text_at(&["faultcode"]).map(local));
    let text = fault.text_at(&["Reason", "Text"]).or(fault.text_at(&["faultstring"]));
    let detail = fault.text_at(&["Detail", "Text"]);
    let mut reason = excerpt(text.or(detail).unwrap_or_default());
    if let Some(code) = codes.last() {
        let code = excerpt(code);
        reason = if reason.is_empty() { code } else { format!("{reason} ({code})") };
    }
    SoapFault { codes, reason }
}

fn local(code: &str) -> String {
    code.rsplit(':').next().unwrap_or(code).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn opened(body: &str) -> Result<Result<Element, SoapFault>, String> {
        let text = format!("<s:Envelope xmlns:s='{ENVELOPE}'><s:Body>{body}</s:Body></s:Envelope>");
        open(&Element::parse(text.as_bytes()).expect("XML"))
    }

    #[test]
    fn faults_of_both_versions_are_read() {
        let fault = opened(
            "<s:Fault><s:Code><s:Value>s:Sender</s:Value><s:Subcode><s:Value>ter:NotAuthorized\
             </s:Value></s:Subcode></s:Code><s:Reason><s:Text xml:lang='en'>Sender not\n authorized\
             </s:Text></s:Reason></s:Fault>",
        );
        let fault = fault.expect("an envelope").expect_err("a fault");
        assert!(fault.is_login_rejected() && !fault.is_unsupported());
        assert_eq!(fault.reason, "Sender not authorized (NotAuthorized)");
        let old = "<Fault><faultcode>ter:ActionNotSupported</faultcode>\
                   <faultstring>nope</faultstring></Fault>";
        let fault = opened(old).expect("an envelope").expect_err("a fault");
        assert!(fault.is_unsupported());
        assert_eq!(fault.reason, "nope (ActionNotSupported)");
        let empty = opened("<s:Fault/>").expect("an envelope").expect_err("a fault");
        assert_eq!(empty.reason, "");
    }

    #[test]
    fn an_answer_that_is_no_envelope_has_a_reason() {
        assert!(opened("").is_err_and(|problem| problem == "its body is empty"));
        let page = Element::parse(b"<html><body/></html>").expect("XML");
        assert!(open(&page).is_err_and(|problem| problem.contains("<html>")));
    }

    #[test]
    fn a_request_hands_reference_parameters_back() {
        let given = "<R xmlns:x='urn:x'><x:Id> 7&lt; </x:Id></R>";
        let given = Element::parse(given.as_bytes()).expect("XML");
        let addressing = Addressing { to: "http://cam/sub?a=1&b=2", parameters: &given.children };
        let operation = Operation { namespace: "urn:n", name: "PullMessages", action: "urn:p" };
        let text = envelope(operation, "<o:Timeout>PT1S</o:Timeout>", "", Some(&addressing));
        let read = Element::parse(text.as_bytes()).expect("XML");
        let id = read.at(&["Header", "Id"]).expect("handed back");
        assert_eq!((id.namespace.as_str(), id.text()), ("urn:x", "7<"));
        assert_eq!(read.text_at(&["Header", "To"]), Some("http://cam/sub?a=1&b=2"));
        assert_eq!(read.text_at(&["Body", "PullMessages", "Timeout"]), Some("PT1S"));
    }
}
