//! The client agent of the host on the endpoint of a plugin. It forwards actions to the plugin's
//! agents, receives the results, and cancels actions when their callers stop waiting.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{Act, ActionToken, CancelAction, Outcome, Refusal, Report, Request, value};
use acl::{AgentId, Millis, Performative, Protocol, ReplyToken};
use actuator::{MethodCall, MethodFailure};
use agent::{Agent, Callbacks, Context, ExchangeEvent, ExchangeOpening, WorkHandle};
use tokio::sync::{mpsc, oneshot};

/// Capacity of the queue of actions that wait to be forwarded. Each agent carries out one action at
/// a time, so the queue stays short.
const ORDERS_MAX: usize = 1_024;

/// Time that an agent of the plugin has for the messages `agree` and `confirm`, in addition to the
/// timeout of the method for the action.
const BESIDE_METHOD: Duration = Duration::from_secs(5);

type ResultSender = oneshot::Sender<Result<Report, MethodFailure>>;

/// Handle of the client agent of a plugin, for forwarding actions. All clones belong to the same
/// client agent.
#[derive(Clone)]
pub(crate) struct PluginClientHandle(mpsc::Sender<ClientOrder>);

enum ClientOrder {
    Act {
        to: AgentId,
        call: MethodCall,
        timeout: Duration,
        number: u64,
        tell: ResultSender,
    },
    /// Cancels the action with this number, because the caller does not wait for the result any
    /// more.
    Cancel(u64),
}

/// The client agent of one plugin, which forwards actions to the plugin's agents and receives their
/// results.
pub(crate) struct PluginClient {
    orders: Option<mpsc::Receiver<ClientOrder>>,
    under_way: BTreeMap<u64, PendingAction>,
    /// Task that waits for the next order to the client agent.
    listening: Option<WorkHandle>,
}

struct PendingAction {
    exchange: ReplyToken,
    to: AgentId,
    tell: ResultSender,
}

/// Cancels a forwarded action when it is dropped before the result of the action has arrived.
struct CancelActionOnDrop {
    client: Option<PluginClientHandle>,
    number: u64,
}

impl PluginClient {
    pub(crate) fn new() -> (PluginClient, PluginClientHandle) {
        let (bell, orders) = mpsc::channel(ORDERS_MAX);
        let (orders, under_way) = (Some(orders), BTreeMap::new());
        (PluginClient { orders, under_way, listening: None }, PluginClientHandle(bell))
    }

    fn next_order(&mut self, ctx: &mut Context<Self>) {
        let Some(mut orders) = self.orders.take() else { return };
        let next = async move {
            let order = orders.recv().await;
            (order, orders)
        };
        let work = ctx.run(next, |attendant: &mut Self, (order, orders), ctx| {
            attendant.orders = Some(orders);
            match order {
                Some(ClientOrder::Act { to, call, timeout, number, tell }) => {
                    attendant.begin_action(to, call, timeout, number, tell, ctx);
                }
                Some(ClientOrder::Cancel(number)) => attendant.cancel_action(number, ctx),
                // All handles were dropped, so the client agent stops receiving orders.
                None => return,
            }
            attendant.next_order(ctx);
        });
        self.listening = Some(work);
    }

    fn begin_action(
        &mut self,
        to: AgentId,
        call: MethodCall,
        timeout: Duration,
        number: u64,
        tell: ResultSender,
        ctx: &mut Context<Self>,
    ) {
        if tell.is_closed() {
            return;
        }
        let conversation = ctx.new_conversation();
        let (term, round) = (ctx.incarnation().0, 0);
        let token = ActionToken { term, conversation: conversation.clone(), round, step: 0 };
        let MethodCall { action, method, arguments } = call;
        let opening = ExchangeOpening {
            to: Some(to.clone()),
            performative: Performative::Request,
            protocol: Protocol::Action,
            conversation,
            content: value(&Request::Act(Box::new(Act {
                action,
                method,
                arguments,
                token,
                // The proxy agent has waited for the others of a joint action.
                ready_for: Some(Millis(Duration::ZERO)),
            }))),
        };
        let exchange =
            ctx.open(opening, timeout + BESIDE_METHOD, move |attendant: &mut Self, answer, ctx| {
                attendant.answered(number, answer, ctx);
            });
        self.under_way.insert(number, PendingAction { exchange, to, tell });
    }

    fn answered(&mut self, number: u64, answer: ExchangeEvent, ctx: &mut Context<Self>) {
        let outcome = match answer {
            ExchangeEvent::TimedOut => {
                Err(MethodFailure::Driver("receive an answer from its plugin in time".to_owned()))
            }
            ExchangeEvent::Undelivered(why) => {
                Err(MethodFailure::Driver(format!("reach its plugin: {why}")))
            }
            ExchangeEvent::Message(message) => match message.performative {
                Performative::Agree => return,
                Performative::Confirm => match message.content_as::<Report>() {
                    Ok(report) if !report.outcome.is_final() => return,
                    Ok(report) => judged(report),
                    Err(error) => {
                        ctx.not_understood(&message, error.to_string());
                        Err(MethodFailure::Driver(format!(
                            "read the answer of its plugin: {error}"
                        )))
                    }
                },
                _ => {
                    let refusal = message.content_as::<Refusal>().map(|refusal| refusal.detail);
                    let why = refusal.unwrap_or_else(|_| "no reason given".to_owned());
                    Err(MethodFailure::Driver(format!("act: its plugin refused: {why}")))
                }
            },
        };
        if let Some(PendingAction { tell, exchange, .. }) = self.under_way.remove(&number) {
            ctx.close(&exchange);
            // The caller may have stopped waiting in the meantime.
            let _ = tell.send(outcome);
        }
    }

    fn cancel_action(&mut self, number: u64, ctx: &mut Context<Self>) {
        if let Some(PendingAction { exchange, to, .. }) = self.under_way.remove(&number) {
            tracing::debug!(agent = %to, "cancels the action");
            ctx.cancel(&exchange, &CancelAction::default());
        }
    }
}

fn judged(report: Report) -> Result<Report, MethodFailure> {
    match report.outcome {
        Outcome::Done => Ok(report),
        _ => {
            let detail = report.detail.strip_prefix("failed to ").unwrap_or(&report.detail);
            Err(MethodFailure::Driver(detail.to_owned()))
        }
    }
}

impl Agent for PluginClient {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.next_order(ctx);
    }
}

impl PluginClientHandle {
    /// Requests an action of an agent of the plugin, and returns the report of the agent. Dropping
    /// the future cancels the action.
    pub(crate) async fn act(
        &self,
        to: AgentId,
        call: MethodCall,
        timeout: Duration,
        number: u64,
    ) -> Result<Report, MethodFailure> {
        let (tell, told) = oneshot::channel();
        let gone = || MethodFailure::Driver("reach its plugin: it is being stopped".to_owned());
        let order = ClientOrder::Act { to, call, timeout, number, tell };
        self.0.try_send(order).map_err(|_| gone())?;
        let mut asked = CancelActionOnDrop { client: Some(self.clone()), number };
        let outcome = told.await.map_err(|_| gone())?;
        asked.client = None;
        outcome
    }
}

impl Drop for CancelActionOnDrop {
    fn drop(&mut self) {
        if let Some(bell) = &self.client {
            // Sending fails if the queue is full or closed. Then the client agent has stopped, or
            // the exchange ends at its deadline.
            let _ = bell.0.try_send(ClientOrder::Cancel(self.number));
        }
    }
}
