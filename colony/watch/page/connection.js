// The WebSocket of the page. It reconnects when the server was away.

const FIRST_DELAY_MS = 250;
const LAST_DELAY_MS = 3000;

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
    this.socket = new WebSocket(`ws://${location.host}/run`, ["colony.watch", token]);
    this.socket.addEventListener("open", () => {
      this.delay = FIRST_DELAY_MS;
      this.onState("open");
    });
    this.socket.addEventListener("message", (event) => this.onMessage(JSON.parse(event.data)));
    this.socket.addEventListener("close", () => {
      this.onState("closed");
      setTimeout(() => this.open(), this.delay);
      this.delay = Math.min(this.delay * 2, LAST_DELAY_MS);
    });
  }

  send(request) {
    if (this.socket && this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(request));
  }
}
