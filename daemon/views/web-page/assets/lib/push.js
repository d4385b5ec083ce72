// Notifications on this device while no page is open (web push), if the daemon sends them.

import { get, post } from "./api.js";

// Returns `{ can, why, isOn, key }`: whether notifications can be had here, and whether they are.
export async function pushState() {
  if (!("serviceWorker" in navigator) || !("PushManager" in globalThis)) return { can: false, why: "push.browser" };
  let offered;
  try {
    offered = await get("/api/push");
  } catch (problem) {
    return { can: false, why: problem.status === 404 ? "push.daemon" : "push.failed" };
  }
  if (typeof offered?.public_key !== "string") return { can: false, why: "push.daemon" };
  const worker = await navigator.serviceWorker.getRegistration("/");
  const subscription = await worker?.pushManager.getSubscription();
  return { can: true, isOn: Boolean(subscription), key: offered.public_key };
}

// Subscribes this device. The browser asks the person.
export async function pushOn(key) {
  if (await Notification.requestPermission() !== "granted") throw new Error("push.denied");
  const worker = await navigator.serviceWorker.register("/assets/service-worker.js", { scope: "/" });
  await navigator.serviceWorker.ready;
  const subscription = await worker.pushManager.subscribe({ userVisibleOnly: true, applicationServerKey: bytes(key) });
  await post("/api/push", subscription.toJSON());
}

// Ends the subscription of this device, also if the daemon is not reached.
export async function pushOff() {
  const worker = await navigator.serviceWorker.getRegistration("/");
  const subscription = await worker?.pushManager.getSubscription();
  if (!subscription) return;
  const { endpoint } = subscription;
  await subscription.unsubscribe();
  await post("/api/push/remove", { endpoint });
}

function bytes(base64url) {
  const text = atob(base64url.replace(/-/g, "+").replace(/_/g, "/"));
  return Uint8Array.from(text, (c) => c.charCodeAt(0));
}
