// The page of `raybrook view`: hands and keys become moves, and the newest picture is asked for as soon as the last one
// is shown. Nothing is queued: moves are summed up until the server has taken those before.
"use strict";

const $ = id => document.getElementById(id);
const canvas = $("picture");
const context = canvas.getContext("2d");

// What is under way is told to tests and style sheets by the body's data attributes.
const shown = document.body.dataset;
let session = 0;
let known = { version: 0, frame: 0 };
let told = null;
let lastPointer = null;

const post = (name, body) => fetch(name, {
  method: "POST",
  headers: { "Content-Type": "application/json" },
  body: JSON.stringify(body),
});

// ---- Pictures ----

const times = [];

async function show(png) {
  const bitmap = await createImageBitmap(new Blob([png], { type: "image/png" }));
  const [width, height] = told.size;
  if (width && (canvas.width !== width || canvas.height !== height)) {
    canvas.width = width;
    canvas.height = height;
  }
  // A coarse picture has fewer pixels.
  context.imageSmoothingEnabled = told.layer === "picture";
  context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
  bitmap.close();
  times.push(performance.now());
  shown.frames = Number(shown.frames || 0) + 1;
}

async function listen() {
  for (;;) {
    let answer;
    try {
      answer = await fetch(`next?session=${session}&version=${known.version}&frame=${known.frame}`);
    } catch {
      lose("raybrook has ended, or cannot be reached");
      await pause();
      continue;
    }
    if (answer.status === 404) {
      await begin();
      continue;
    }
    if (answer.status === 403) {
      lose("another raybrook listens here now: open the address that it has printed");
      return;
    }
    if (answer.status !== 200) {
      if (answer.status !== 204) await pause(); // not at once, where there is too much to do already
      continue;
    }
    const bytes = await answer.arrayBuffer();
    const length = new DataView(bytes).getUint32(0);
    told = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
    known = { version: told.version, frame: told.frame };
    const png = new Uint8Array(bytes, 4 + length);
    if (png.length) {
      // What is told is of this picture, which is not to be seen yet.
      shown.state = "working";
      await show(png);
    }
    tell();
  }
}

function lose(why) {
  shown.state = "lost";
  $("state").textContent = why;
}

async function begin() {
  try {
    const answer = await post("begin", null);
    if (!answer.ok) {
      lose(await answer.text());
      return pause();
    }
    session = (await answer.json()).session;
    known = { version: 0, frame: 0 };
    $("layer").value = "picture";
    setStops(0);
  } catch {
    lose("raybrook has ended, or cannot be reached");
    await pause();
  }
}

function pause() {
  return new Promise(done => setTimeout(done, 1000));
}

// ---- What is told ----

const set = (id, text) => { if ($(id).textContent !== text) $(id).textContent = text; };
const grouped = number => Math.round(number).toLocaleString("en");

function tell() {
  set("scene", told.scene);
  document.title = `${told.scene} – raybrook view`;
  const picture = told.picture;
  const size = told.size[0] ? `${told.size[0]}x${told.size[1]}, ` : "";
  const done = told.refused ? "no picture" : told.is_finished ? "finished" : "refining …";
  const work = told.busy ? told.busy + " …" : done;
  set("state", `${grouped(told.triangles)} triangles, ${size}${told.device ? told.device + ", " : ""}${work}`);
  const notice = told.notice || told.refused;
  $("notice").hidden = !notice;
  set("notice", notice || "");
  set("method", told.method.replaceAll(" --", "\n--"));
  ["structure", "traversal", "intersector"].forEach(part => {
    if (document.activeElement !== $(part)) $(part).value = told.asked[part] || "auto";
  });
  shown.layer = told.layer;
  shown.notice = notice || "";
  shown.state = told.is_finished ? "done" : "working";
  ["png", "exr"].forEach(ending => {
    const link = $(`save-${ending}`);
    link.setAttribute("aria-disabled", String(!told.is_finished));
    if (told.is_finished) link.href = `picture.${ending}?session=${session}`;
    else link.removeAttribute("href");
  });
  if (picture) tellPicture(picture);
  if (told.is_finished && lastPointer) pick(lastPointer);
}

function tellPicture(picture) {
  set("label", picture.label);
  set("rays", grouped(picture.rays));
  set("rate", picture.mrays_per_s ? picture.mrays_per_s.toFixed(2) : "–");
  set("error", picture.error === undefined ? "–" : `${picture.error.toFixed(2)} of 255`);
  const isCounted = picture.brightest !== undefined || picture.wrong !== undefined;
  $("counted-name").hidden = $("counted").hidden = !isCounted;
  if (picture.wrong !== undefined) {
    set("counted-name", "wrong pixels");
    set("counted", `${grouped(picture.wrong)} of ${grouped(picture.pixels)}`);
    shown.wrong = picture.wrong;
  } else if (isCounted) {
    set("counted-name", "brightest colour");
    set("counted", `${grouped(picture.brightest)} ${told.layer} a pixel`);
  }
}

setInterval(() => {
  const now = performance.now();
  while (times.length && times[0] < now - 1000) times.shift();
  set("frames", times.length ? String(times.length) : "–");
}, 500);

// ---- Moves ----

let waiting = {};
let isSending = false;

// Adds numbers to those of the same kind that wait.
function move(kind, by) {
  const before = waiting[kind];
  if (before === undefined || kind === "reset") waiting[kind] = by;
  else waiting[kind] = Array.isArray(by) ? by.map((x, i) => x + before[i]) : before + by;
  send();
}

async function send() {
  if (isSending || !session) return;
  isSending = true;
  while (Object.keys(waiting).length) {
    const moves = Object.entries(waiting).map(([kind, by]) => kind === "reset" ? "reset" : { [kind]: by });
    waiting = {};
    try {
      await post("act", { session, moves });
    } catch {
      break;
    }
  }
  isSending = false;
}

const act = what => post("act", { session, moves: [], ...what }).catch(() => {});

// ---- Pointers ----

const pointers = new Map();
let lastTap = { time: 0, x: 0, y: 0 };

// A place on the canvas in pixels of the picture.
function place(event) {
  const box = canvas.getBoundingClientRect();
  const part = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  return { x: part[0] * canvas.width, y: part[1] * canvas.height };
}

canvas.addEventListener("pointerdown", event => {
  canvas.focus({ preventScroll: true });
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  event.preventDefault();
});

canvas.addEventListener("pointermove", event => {
  const before = pointers.get(event.pointerId);
  lastPointer = place(event);
  if (!before) return pick(lastPointer);
  const height = canvas.getBoundingClientRect().height;
  const by = [(event.clientX - before.x) / height, (event.clientY - before.y) / height];
  const other = [...pointers].find(([id]) => id !== event.pointerId);
  pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  if (other) {
    const distance = from => Math.hypot(from.x - other[1].x, from.y - other[1].y);
    const [old, now] = [distance(before), distance({ x: event.clientX, y: event.clientY })];
    if (old > 0 && now > 0) move("zoom", Math.log(now / old));
    move("pan", by.map(x => x / 2));
  } else if (event.altKey) {
    move("look", by);
  } else if (event.shiftKey || event.buttons & 6) {
    move("pan", by);
  } else {
    move("orbit", by);
  }
});

const lift = event => {
  if (!pointers.delete(event.pointerId) || event.type === "pointercancel") return;
  pick(place(event));
};
canvas.addEventListener("pointerup", lift);
canvas.addEventListener("pointercancel", lift);
canvas.addEventListener("pointerleave", () => { lastPointer = null; });
canvas.addEventListener("contextmenu", event => event.preventDefault());
canvas.addEventListener("wheel", event => {
  event.preventDefault();
  const lines = event.deltaMode === 1 ? 16 : 1;
  move("zoom", -event.deltaY * lines / 500);
}, { passive: false });
canvas.addEventListener("dblclick", event => aimAt(place(event)));
canvas.addEventListener("touchend", event => {
  const touch = event.changedTouches[0];
  const tap = { time: event.timeStamp, x: touch.clientX, y: touch.clientY };
  const isDouble = tap.time - lastTap.time < 350 && Math.hypot(tap.x - lastTap.x, tap.y - lastTap.y) < 30;
  if (isDouble) aimAt(place(touch));
  lastTap = tap;
});

// ---- Picking ----

let nextPick = null;
let isPicking = false;

const numbers = list => list.map(x => Number(x.toPrecision(6))).join(", ");

async function pick(at) {
  nextPick = at;
  if (isPicking || !session) return;
  isPicking = true;
  while (nextPick) {
    const now = nextPick;
    nextPick = null;
    try {
      const answer = await post("pick", { session, ...now });
      if (answer.ok) tellPicked(await answer.json());
    } catch {
      break;
    }
  }
  isPicking = false;
}

function tellPicked(picked) {
  const hit = picked.hit;
  shown.picked = JSON.stringify(picked);
  set("material", hit ? hit.material || "–" : "nothing");
  set("triangle", hit ? String(hit.triangle) : "–");
  set("t", hit ? String(hit.t) : "–");
  set("uv", hit ? numbers([hit.u, hit.v]) : "–");
  set("position", hit ? numbers(hit.position) : "–");
}

async function aimAt(at) {
  const answer = await post("pick", { session, ...at }).catch(() => null);
  const hit = answer && answer.ok && (await answer.json()).hit;
  if (hit) act({ moves: [{ target: hit.position }] });
}

// ---- Keys ----

const flying = {
  KeyW: [0, 0, 1], KeyS: [0, 0, -1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyE: [0, 1, 0], KeyQ: [0, -1, 0],
};
const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const layers = ["picture", "wrong", "steps", "tests", "leaves"];
const held = new Set();
let isFast = false;
let lastFlight = 0;

// Diagonals of the scene a second.
const SPEED = 0.25;

function fly(now) {
  if (!held.size) return;
  const step = SPEED * (isFast ? 4 : 1) * Math.min(now - lastFlight, 100) / 1000;
  lastFlight = now;
  const sum = [0, 1, 2].map(axis => [...held].reduce((total, key) => total + flying[key][axis], 0));
  move("fly", sum.map(x => x * step));
  requestAnimationFrame(fly);
}

addEventListener("keydown", event => {
  // Lists, buttons and the dialog have keys of their own.
  if (event.ctrlKey || event.metaKey || ![canvas, document.body].includes(event.target)) return;
  isFast = event.shiftKey;
  if (flying[event.code]) {
    if (!held.size) {
      lastFlight = performance.now();
      requestAnimationFrame(fly);
    }
    held.add(event.code);
  } else if (arrows[event.key]) {
    move(event.shiftKey ? "pan" : "orbit", arrows[event.key].map(x => x * 0.05));
  } else if (event.key === "+" || event.key === "=") {
    move("zoom", 0.1);
  } else if (event.key === "-") {
    move("zoom", -0.1);
  } else if (event.key === "Home" || event.key === "0") {
    reset();
  } else if (layers[Number(event.key) - 1]) {
    setLayer(layers[Number(event.key) - 1]);
  } else {
    return;
  }
  event.preventDefault();
});
addEventListener("keydown", event => { if (event.key === "?") $("help").showModal(); });
addEventListener("keyup", event => { held.delete(event.code); isFast = event.shiftKey; });
addEventListener("blur", () => held.clear());

// ---- The panel ----

function reset() {
  waiting = {};
  move("reset", true);
}

function setLayer(layer) {
  $("layer").value = layer;
  act({ layer });
}

function setStops(stops) {
  $("exposure").value = stops;
  set("stops", String(stops));
}

function fill(part, names) {
  for (const name of ["auto", ...names]) $(part).append(new Option(name, name));
  $(part).addEventListener("change", () => {
    // Only a kd-tree is traversed in several ways.
    if (part === "structure" && $("structure").value !== "kd") $("traversal").value = "auto";
    if (part === "traversal" && $("traversal").value !== "auto") $("structure").value = "kd";
    const asked = Object.fromEntries(["structure", "traversal", "intersector"].map(part => [part, $(part).value]));
    document.activeElement.blur();
    post("method", asked).catch(() => {});
  });
}

async function copy(text) {
  let isCopied = true;
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // Without a clipboard the text can be marked by hand.
    isCopied = false;
  }
  set("copied", (isCopied ? "copied: " : "") + text);
}

$("layer").addEventListener("change", () => act({ layer: $("layer").value }));
$("exposure").addEventListener("input", () => {
  const stops = Number($("exposure").value);
  setStops(stops);
  act({ exposure: stops });
});
$("copy-toml").addEventListener("click", () => told && copy(told.camera.toml));
$("copy-command").addEventListener("click", () => told && copy(`${told.command} ${told.camera.options}`));
$("reset").addEventListener("click", reset);
$("keys").addEventListener("click", () => $("help").showModal());
addEventListener("pagehide", () => {
  fetch("end", { method: "POST", body: JSON.stringify(session), keepalive: true }).catch(() => {});
});
addEventListener("pageshow", event => { if (event.persisted) location.reload(); });

fetch("methods").then(answer => answer.json()).then(methods => {
  Object.entries(methods).forEach(([part, names]) => fill(part, names));
}).catch(() => {});
begin().then(listen);
