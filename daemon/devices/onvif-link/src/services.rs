//! The services of a camera: their namespaces, their addresses, and calls of their operations.

use crate::address::Address;
use crate::error::LinkError;
use crate::session::{CALL_TIME_MAX, Call, CameraSession, DEVICE};
use crate::soap::Operation;
use crate::xml::Element;

pub(crate) const MEDIA: &str = "http://www.onvif.org/ver10/media/wsdl";
const MEDIA_2: &str = "http://www.onvif.org/ver20/media/wsdl";
pub(crate) const PTZ: &str = "http://www.onvif.org/ver20/ptz/wsdl";
pub(crate) const EVENTS: &str = "http://www.onvif.org/ver10/events/wsdl";

/// The addresses of the services that are used.
pub(crate) struct Services {
    pub(crate) media: Address,
    pub(crate) media_namespace: &'static str,
    pub(crate) ptz: Option<Address>,
    pub(crate) events: Option<Address>,
}

impl Services {
    /// Reads the addresses from the camera's list of services, and then from its list of
    /// capabilities if one is missing. Old cameras have the second list only, and some cameras
    /// leave services out of one of the two.
    pub(crate) async fn read(session: &CameraSession) -> Result<Services, LinkError> {
        let listed = Services::listed(session).await?;
        let mut media = listed.iter().find(|(known, _)| known == MEDIA).map(|(_, at)| at.clone());
        let find = |namespace: &str| {
            listed.iter().find(|(known, _)| known == namespace).map(|(_, at)| at.clone())
        };
        let (mut ptz, mut events, media_2) = (find(PTZ), find(EVENTS), find(MEDIA_2));
        if (media.is_none() && media_2.is_none()) || ptz.is_none() || events.is_none() {
            let [more_media, more_ptz, more_events] = Services::capabilities(session).await?;
            media = media.or(more_media);
            (ptz, events) = (ptz.or(more_ptz), events.or(more_events));
        }
        let media = media.map(|at| (at, MEDIA)).or(media_2.map(|at| (at, MEDIA_2)));
        let Some((media, media_namespace)) = media else {
            let (call, problem) =
                ("GetServices".to_owned(), "it has no service of pictures (media)".to_owned());
            return Err(LinkError::Unreadable { call, problem });
        };
        Ok(Services { media, media_namespace, ptz, events })
    }

    /// Returns the services in the list of the camera, each with its namespace.
    async fn listed(session: &CameraSession) -> Result<Vec<(String, Address)>, LinkError> {
        let content = "<o:IncludeCapability>false</o:IncludeCapability>";
        let at = session.address();
        let answer = match call(session, at, DEVICE, "GetServices", content).await {
            Ok(answer) => answer,
            Err(LinkError::Fault { .. } | LinkError::Unsupported(_)) => return Ok(Vec::new()),
            Err(error) => return Err(error),
        };
        let services = answer.all("Service").filter_map(|service| {
            let namespace = service.text_at(&["Namespace"])?.to_owned();
            Some((namespace, session.resolve(service.text_at(&["XAddr"])?)?))
        });
        Ok(services.collect())
    }

    /// Returns the services of pictures, motors and events in the capabilities of the camera.
    async fn capabilities(session: &CameraSession) -> Result<[Option<Address>; 3], LinkError> {
        let content = "<o:Category>All</o:Category>";
        let at = session.address();
        let answer = match call(session, at, DEVICE, "GetCapabilities", content).await {
            Ok(answer) => answer,
            Err(LinkError::Fault { .. } | LinkError::Unsupported(_)) => {
                return Ok([const { None }; 3]);
            }
            Err(error) => return Err(error),
        };
        let all = answer.find("Capabilities");
        Ok(["Media", "PTZ", "Events"]
            .map(|name| session.resolve(all.and_then(|all| all.text_at(&[name, "XAddr"]))?)))
    }
}

/// Calls an operation of a service that needs no WS-Addressing.
pub(crate) async fn call(
    session: &CameraSession,
    at: &Address,
    namespace: &str,
    name: &str,
    content: &str,
) -> Result<Element, LinkError> {
    let action = format!("{namespace}/{name}");
    let operation = Operation { namespace, name, action: &action };
    let time_max = CALL_TIME_MAX;
    session.call(&Call { at, operation, content, addressing: None, time_max }).await
}
