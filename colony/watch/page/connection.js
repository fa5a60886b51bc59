// The WebSocket of the page. It reconnects when the server was away.
//
// Page and server prove to each other that they know the token, and send nothing else before: whoever else
// listens at the port, while the server is away, gets neither the token nor a request.

const FIRST_DELAY_MS = 250;
const LAST_DELAY_MS = 3000;
const GREETING_MS = 5000;
const REFUSED = 4403;

const encoder = new TextEncoder();

const hex = (bytes) => Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");

/** The proof that a side knows the token, for the nonce of the other side. */
async function proof(token, side, nonce) {
  const hmac = { name: "HMAC", hash: "SHA-256" };
  const key = await crypto.subtle.importKey("raw", encoder.encode(token), hmac, false, ["sign"]);
  const text = `colony.watch ${side} ${nonce} ${location.host}`;
  return hex(new Uint8Array(await crypto.subtle.sign("HMAC", key, encoder.encode(text))));
}

export class Connection {
  constructor({ onMessage, onState }) {
    this.onMessage = onMessage;
    this.onState = onState;
    this.delay = FIRST_DELAY_MS;
    this.open();
  }

  open() {
    const token = location.hash.slice(1);
    if (!token) {
      this.onState("no token");
      return;
    }
    const nonce = hex(crypto.getRandomValues(new Uint8Array(16)));
    const socket = new WebSocket(`ws://${location.host}/run`, ["colony.watch", nonce]);
    this.socket = null;
    let greeted = false;
    const silence = setTimeout(() => socket.close(), GREETING_MS);
    socket.addEventListener("message", async (event) => {
      const message = JSON.parse(event.data);
      if (this.socket === socket) {
        this.onMessage(message);
        return;
      }
      if (greeted) return;
      greeted = true;
      clearTimeout(silence);
      if (message.proof !== (await proof(token, "server", nonce))) {
        this.onState("stranger");
        socket.close();
        return;
      }
      const reply = JSON.stringify({ proof: await proof(token, "page", message.nonce) });
      if (socket.readyState !== WebSocket.OPEN) return;
      socket.send(reply);
      this.socket = socket;
      this.delay = FIRST_DELAY_MS;
      this.onState("open");
    });
    socket.addEventListener("close", (event) => {
      clearTimeout(silence);
      this.socket = null;
      this.onState(event.code === REFUSED ? "refused" : "closed");
      setTimeout(() => this.open(), this.delay);
      this.delay = Math.min(this.delay * 2, LAST_DELAY_MS);
    });
  }

  send(request) {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(request));
  }
}
