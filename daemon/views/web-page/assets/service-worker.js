// Shows notifications that arrive while no page is open, and opens the page that one is about. It
// keeps no files: what the page shows always comes from the daemon.

const OPENING = "/";

addEventListener("install", () => self.skipWaiting());
addEventListener("activate", (event) => event.waitUntil(self.clients.claim()));

addEventListener("push", (event) => {
  let said = {};
  try {
    said = event.data?.json() ?? {};
  } catch {
    // A payload that cannot be read still tells that there is something.
  }
  const title = plain(said.title) || "Althing";
  event.waitUntil(self.registration.showNotification(title, {
    body: plain(said.text), tag: plain(said.id) || undefined, icon: "/assets/icon-192.png",
    timestamp: Number.isFinite(said.at) ? said.at : undefined, requireInteraction: said.urgent === true,
    data: { address: own(said.link) },
  }));
});

addEventListener("notificationclick", (event) => {
  event.notification.close();
  event.waitUntil(open(event.notification.data?.address ?? OPENING));
});

async function open(address) {
  const pages = await self.clients.matchAll({ type: "window" });
  const page = pages.find((one) => "navigate" in one);
  if (!page) return self.clients.openWindow(address);
  await page.focus();
  return page.navigate(address);
}

// The address of a link if it is one of this page; otherwise the overview.
function own(link) {
  try {
    const url = new URL(link, self.location.origin);
    return url.origin === self.location.origin ? url.pathname + url.search : OPENING;
  } catch {
    return OPENING;
  }
}

// A text without the characters that reorder or hide what a person reads.
function plain(text) {
  return typeof text === "string" ? text.replace(/[\p{Cc}\p{Cf}\u2028\u2029]/gu, "·").slice(0, 500) : "";
}
