// The page: it shows what the server sends, and sends what the user asks for. It decides nothing.

import { Cameras } from "./cameras.js";
import { Commands, Judged } from "./commands.js";
import { Connection } from "./connection.js";
import { element, setText } from "./drawing.js";
import { WorldMap } from "./map.js";
import { Network } from "./network.js";
import { Sensors } from "./sensors.js";
import { Timeline } from "./timeline.js";

const $ = (id) => document.getElementById(id);

const page = { scene: null, views: [], snapshot: null, fresh: false, player: {}, isLive: false, isOpen: false, troubles: [] };

/** Counters, for measurements of the page. */
globalThis.colonyWatch = { received: 0, drawn: 0 };

const timeline = new Timeline($("timeline"), (t) => send({ do: "seek", t }));
const connection = new Connection({ onMessage: receive, onState: showConnection });

function send(request) {
  connection.send(request);
}

function receive(message) {
  if (message.scene) setUp(message);
  if (message.history) {
    page.sensors.history(message.history);
    page.map.reset(message.path);
  }
  if (message.snapshot) {
    globalThis.colonyWatch.received += 1;
    page.snapshot = message.snapshot;
    page.player = message.player;
    if (!page.fresh) requestAnimationFrame(draw);
    page.fresh = true;
  }
  if ("problem" in message) page.problem = message.problem;
  if (message.seen) {
    page.cameras.show(message.seen.pictures);
    page.map.setEllipse(message.seen.ellipse);
    page.troubles = message.seen.troubles;
  }
  if (message.timeline) timeline.load(message.timeline);
  if (message.answer) showAnswer(message.answer);
  if (message.refused) say(message.refused);
  if (message.stop) say(message.stop.text);
  if (message.tuned) say(message.tuned);
  showMode();
}

function setUp({ scene, live, may_stop, may_ask, may_tune }) {
  const chosen = page.network?.chosen;
  if (page.scene && page.scene.title !== scene.title) say(scene.is_idle ? scene.title : `${scene.title} follows`);
  page.scene = scene;
  page.snapshot = null;
  timeline.clear();
  page.isLive = live;
  page.troubles = [];
  page.mayAsk = may_ask;
  setText($("robot"), scene.robot);
  const description = scene.description === scene.robot ? "" : `(${scene.description}) `;
  setText($("title"), description + scene.title);
  document.title = `${scene.robot} – colony watch`;
  $("stop").hidden = !may_stop;
  $("follow").hidden = !live;
  $("network").hidden = scene.is_idle;
  page.network = new Network($("network"), $("zoom"), scene, choose);
  page.sensors = new Sensors({ polars: $("polars"), lamps: $("lamps"), strips: $("strips") }, scene,
    may_tune ? (param, value) => send({ do: "tune", param, value }) : null);
  page.cameras = new Cameras($("cameras"));
  page.map = page.map ?? new WorldMap($("map"));
  page.map.load(scene);
  page.views = [
    page.network, page.sensors, page.map, new Commands($("commands"), scene),
    new Judged({ contracts: $("contracts"), states: $("states") }, scene),
  ];
  if (scene.modules.includes(chosen)) page.network.choose(chosen);
  else if (scene.is_idle) showReason("No program runs", "Once `colony drive FILE` starts one, this page shows it.");
  else showReason("Why?", "Choose a module to ask why it commands, or why not.");
}

function draw() {
  page.fresh = false;
  if (!page.snapshot) return;
  const { snapshot, player } = page;
  for (const view of page.views) view.show(snapshot);
  timeline.show(snapshot.t);
  setText($("clock"), `${snapshot.t.toFixed(2)} s · frame ${snapshot.k}`);
  const isMoving = player.playing || player.following;
  showAlarms(snapshot.late, isMoving);
  $("play-shape").setAttribute("d", isMoving ? "M4 3h2.5v10H4zM9.5 3H12v10H9.5z" : "M4 2.5L13 8l-9 5.5z");
  $("play").setAttribute("aria-label", isMoving ? "pause" : "play");
  $("follow").disabled = player.following;
  page.cameras.setFollowing(player.following);
  page.map.setFollowing(player.following);
  if (page.network.chosen && !isMoving && page.asked !== snapshot.k) ask(page.network.chosen);
  globalThis.colonyWatch.drawn += 1;
}

function showMode() {
  const badge = $("mode");
  const stopped = page.snapshot?.stopped_by;
  let [text, kind] = [page.isLive ? "live" : "recorded", page.isLive ? "live" : ""];
  if (page.isLive && page.snapshot && !page.player.following) [text, kind] = ["live, looking back", ""];
  if (page.scene && !page.snapshot) [text, kind] = ["waiting for frames", "trouble"];
  if (page.snapshot && !page.snapshot.is_known) [text, kind] = [`${text}, memory unknown`, "trouble"];
  if (stopped !== null && stopped !== undefined) [text, kind] = [`STOPPED${stopped ? ` by ${stopped}` : ""}`, "stopped"];
  if (page.problem) [text, kind] = [page.problem, "trouble"];
  if (!page.isOpen) [text, kind] = ["no connection", "trouble"];
  setText(badge, text);
  badge.className = `badge ${kind}`;
}

const ADVICE = "open the address that `colony watch` printed";
const CONNECTION_PROBLEMS = {
  "no token": `${ADVICE}: it ends in a token`,
  refused: `refused: the token is wrong, or too many pages are open; ${ADVICE}`,
  stranger: `another program, or another token, is at this address; ${ADVICE}`,
};

function showConnection(state) {
  page.isOpen = state === "open";
  if (state in CONNECTION_PROBLEMS) say(CONNECTION_PROBLEMS[state]);
  showMode();
}

const ALARM_MS = 2000;
const alarms = new Map();

/** Show what fails now, and who is late. In a run that moves an alarm stays for a while, so that nothing flickers. */
function showAlarms(now, isMoving) {
  const time = performance.now();
  if (!isMoving) alarms.clear();
  for (const alarm of now) alarms.set(alarm, time + ALARM_MS);
  for (const [alarm, end] of alarms) if (end < time) alarms.delete(alarm);
  const late = [...alarms.keys()].sort();
  if (page.player.following) late.unshift(...page.troubles);
  const text = late.join("\n");
  if (text === page.alarms) return;
  page.alarms = text;
  const shown = late.slice(0, 4).map((alarm) => element("li", { title: alarm }, alarm));
  if (late.length > 4) shown.push(element("li", {}, `${late.length - 4} more`));
  $("alarms").replaceChildren(...shown);
}

// --- asking ---------------------------------------------------------------------------------------

function choose(module) {
  page.network.choose(module);
  if (!page.snapshot) return showReason(module, "");
  const state = page.snapshot.modules[page.scene.modules.indexOf(module)];
  showReason(module, page.mayAsk ? "…" : state);
  ask(module);
}

/** Ask why of the frame that is shown; where the run rests, every frame that is shown is asked for. */
function ask(module) {
  page.asked = page.snapshot.k;
  if (page.mayAsk) send({ do: "ask", module, k: page.snapshot.k });
}

function showAnswer({ module, k, lines }) {
  if (module !== page.network.chosen) return;
  showReason(`${module}, frame ${k}`, lines.join("\n"));
}

/** Show a reason, line by line: what does not fit in a line goes on below it, further in. */
function showReason(title, text) {
  setText($("reason-title"), title);
  if (text === page.reason) return;
  page.reason = text;
  $("reason-text").replaceChildren(...text.split("\n").map((line) => {
    const indent = line.search(/\S|$/);
    const shown = element("div", {}, line.slice(indent));
    shown.style.marginLeft = `${indent / 2 + 2}ch`;
    return shown;
  }));
}

function say(text) {
  setText($("message"), text);
  clearTimeout(page.sayingUntil);
  page.sayingUntil = setTimeout(() => setText($("message"), ""), 8000);
}

// --- controls -------------------------------------------------------------------------------------

const speed = () => Number($("speed").value);
const toggle = () => send(page.player.playing || page.player.following ? { do: "pause" } : { do: "play", speed: speed() });
const jump = (backward) => send({ do: "jump", kinds: Number($("kinds").value), backward });
const step = (frames) => send({ do: "step", frames });

$("play").addEventListener("click", toggle);
$("back").addEventListener("click", () => jump(true));
$("next").addEventListener("click", () => jump(false));
$("follow").addEventListener("click", () => send({ do: "follow" }));
$("stop").addEventListener("click", () => send({ do: "stop" }));
$("speed").addEventListener("change", () => send({ do: "play", speed: speed() }));

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("button, select")) return;
  const second = Math.max(1, Math.round(1 / (page.scene?.frame_s ?? 0.05)));
  const actions = {
    " ": toggle, n: () => jump(false), p: () => jump(true),
    ArrowLeft: () => step(event.shiftKey ? -second : -1), ArrowRight: () => step(event.shiftKey ? second : 1),
    Home: () => send({ do: "seek", t: 0 }), End: () => send({ do: "seek", t: 1e9 }),
  };
  const action = actions[event.key];
  if (!action) return;
  event.preventDefault();
  action();
});
