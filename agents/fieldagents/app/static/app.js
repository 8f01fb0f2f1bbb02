// The page of `fieldgym open`. Whatever it does is a call of fieldagents.app.session, which section 7 shows.
"use strict";
const $ = (id) => document.getElementById(id);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
let state = { logs: [], models: [] }, span = null, view = null, charts = [], runs = [], asked = 0;

async function call(name, body) {
  const response = await fetch(`api/${name}`, body === undefined ? {} : {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
  return read(response);
}

async function read(response) {
  const binary = response.headers.get("Content-Type") === "application/octet-stream";
  const result = binary ? new Float64Array(await response.arrayBuffer()) : await response.json().catch(
    () => ({ error: "the program has ended, or refuses: open its address again" }));
  if (!response.ok) throw new Error(result.error || response.statusText);
  return result;
}

async function attempt(action) {
  $("trouble").textContent = "";
  try { await action(); } catch (error) { $("trouble").textContent = error.message; }
}

function add(parent, tag, words = "", more = {}) {
  const made = Object.assign(document.createElement(tag), more);
  made.textContent = words;
  parent.append(made);
  return made;
}

// Charts -------------------------------------------------------------------------------------------------------

function plot(parent, title, series, data, height, zoomed) {
  const box = add(parent, "div");
  add(box, "h3", title);
  const axis = { stroke: colour("soft"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line") } };
  const options = {
    width: Math.max(parent.clientWidth, 200), height, legend: { show: series.length > 1 },
    cursor: { sync: { key: "time" }, drag: { x: true, y: false, setScale: false } },
    scales: { x: { time: false } }, axes: [{ ...axis }, { ...axis, size: 56 }],
    series: [{ label: "t" }, ...series.map((s) => ({ width: 1.3, spanGaps: false, ...s }))],
    hooks: { setSelect: [(u) => u.select.width > 3 && zoomed &&
      zoomed(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"))] },
  };
  const chart = new uPlot(options, data, box);
  box.setAttribute("role", "img");
  box.setAttribute("aria-label", `curve of ${title}`);
  box.addEventListener("dblclick", () => zoomed && zoomed(...span));
  return chart;
}

async function drawSignals() {
  $("signals").replaceChildren();
  charts = [];
  for (const [number, log] of state.logs.entries())
    for (const [name, unit] of Object.entries(log.columns)) {
      const title = `${state.logs.length > 1 ? `${log.name}: ` : ""}${name}${unit && !name.includes(`[${unit}]`) ? ` [${unit}]` : ""}`;
      const chart = plot($("signals"), title, [{ label: name, stroke: colour("after") }], [[], []], 130, zoom);
      charts.push({ number, name, chart });
    }
  if (state.logs.length) {
    span = [Math.min(...state.logs.map((l) => l.span[0])), Math.max(...state.logs.map((l) => l.span[1]))];
    await zoom(...span);
  }
}

async function zoom(begin, end) {
  view = [begin, end];
  const order = ++asked; // the latest wins
  const width = Math.round($("signals").clientWidth * (window.devicePixelRatio || 1));
  for (const { number, name, chart } of charts) {
    const query = new URLSearchParams({ log: number, name, begin, end, width });
    const rows = await read(await fetch(`api/signal?${query}`));
    if (order !== asked) return;
    const n = rows.length / 2;
    chart.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    chart.setData([rows.subarray(0, n), rows.subarray(n)], false);
    chart.batch(() => { chart.setScale("x", { min: begin, max: end }); chart.setScale("y", limits(rows.subarray(n))); });
  }
  document.body.dataset.drawn = String(order);
}

function limits(...all) {
  let low = Infinity, high = -Infinity;
  for (const values of all) for (const v of values) if (Number.isFinite(v)) { low = Math.min(low, v); high = Math.max(high, v); }
  if (!(high > low)) return { min: (Number.isFinite(low) ? low : 0) - 1, max: (Number.isFinite(high) ? high : 0) + 1 };
  return { min: low - 0.05 * (high - low), max: high + 0.05 * (high - low) };
}

// Steps --------------------------------------------------------------------------------------------------------

async function show(next, logsChanged) {
  state = next;
  $("logs").replaceChildren();
  for (const log of state.logs) {
    const clock = log.clock ? `${log.span[1].toPrecision(4)} s by ${log.clock}` : "no column of times";
    add($("logs"), "li", `${log.name}: ${log.rows} rows of ${Object.keys(log.columns).length} signals, ${clock}`);
  }
  const timed = state.logs.map((log) => log.clock ? "seconds from its start" : "rows");
  $("against").textContent = !timed.length ? "" : new Set(timed).size === 1 ? `Each log over ${timed[0]}.`
    : `Over ${state.logs.map((log, k) => `${timed[k]} (${log.name})`).join(", ")}.`;
  if (!$("model").options.length)
    for (const name of state.models) add($("model"), "option", name, { value: name, selected: name === "rig" });
  $("files").replaceChildren();
  const names = state.diagnosed ? [...state.files, "model.py", "figures/answer.png", "figures/answer.csv"] : [];
  for (const name of names) {
    const link = add($("files"), "a", name, { href: `file/${name}` });
    if (name === "report.html") link.target = "_blank"; else link.download = name.split("/").pop();
  }
  if (!names.length) add($("files"), "span", "Nothing yet.", { className: "soft" });
  $("script").textContent = (await call("script")).script;
  if (logsChanged) await drawSignals();
}

async function drop(files) { // [file, path within a dropped folder]
  const keys = [], folders = {};
  for (const [file, path] of files) {
    const [top, ...inside] = path.split("/");
    const query = new URLSearchParams({ name: top });
    if (inside.length) query.set("inside", inside.join("/"));
    if (folders[top]) query.set("folder", folders[top]);
    const { dropped } = await read(await fetch(`api/drop?${query}`, { method: "POST", body: file }));
    if (inside.length) folders[top] = dropped;
    if (!keys.includes(dropped)) keys.push(dropped);
  }
  try { await call("open", { dropped: keys }); } finally { await show(await call("state"), true); }
}

async function inside(entry) { // of a folder all files but its films and hidden ones
  if (entry.isFile) return [[await new Promise((done, failed) => entry.file(done, failed)), entry.fullPath.slice(1)]];
  const reader = entry.createReader(), found = [];
  for (;;) { // a hundred at a time
    const some = await new Promise((done, failed) => reader.readEntries(done, failed));
    if (!some.length) return found;
    for (const one of some) if (!/^\.|\.(mp4|avi|png|jpe?g)$/i.test(one.name)) found.push(...await inside(one));
  }
}

async function propose() {
  const model = $("own").value.trim() || $("model").value;
  const found = await call("propose", { model, rate: Number($("rate").value) || null });
  const body = $("columns").querySelector("tbody");
  body.replaceChildren();
  const known = Object.fromEntries(found.columns.map((c) => [c.role, c]));
  for (const [role, unit] of Object.entries(found.roles)) {
    const row = add(body, "tr"), column = known[role];
    add(add(row, "td"), "label", `${role} [${unit}]`, { htmlFor: `column-${role}` });
    add(add(row, "td"), "input", "", { id: `column-${role}`, name: role, value: column ? column.spec : "" });
    const still = found.constant.length ? ` (no command, as it never changes: ${found.constant.join(", ")})` : "";
    const lacks = found.missing.includes(role) ? `not found: name a column${still}` : "optional";
    const why = column ? column.why.join("; ") : lacks;
    const sure = column ? ` (${Math.round(100 * column.confidence)} % sure)` : "";
    add(row, "td", why + sure, { className: column && column.confidence >= 0.9 ? "soft" : "warn" });
  }
  $("columns").hidden = false;
  $("script").textContent = (await call("script")).script;
}

async function diagnose() {
  const fields = [...$("columns").querySelectorAll("input")];
  await show(await call("diagnose", { columns: Object.fromEntries(fields.map((f) => [f.name, f.value.trim()])) }));
  await watch();
}

async function watch() {
  $("work").hidden = false;
  for (;;) {
    const next = await call("state");
    $("progress").value = next.job.share;
    $("stage").textContent = next.job.stage;
    if (!next.job.running) {
      $("work").hidden = true;
      await show(next);
      if (next.job.error) throw new Error(next.job.error);
      await readAnswer();
      return;
    }
    await new Promise((done) => setTimeout(done, 300));
  }
}

async function readAnswer() {
  const found = await call("answer");
  $("answer").innerHTML = found.html; // made and escaped by the program
  add($("answer"), "a", "The whole report, with its evidence", { href: "file/report.html", target: "_blank" });
  $("next").hidden = false;
  $("plan").textContent = found.next || "No further measurement is needed to decide between causes.";
  if (state.files.includes("next_input.csv")) add($("plan"), "a", " next_input.csv", { href: "file/next_input.csv" });
  $("try").hidden = !found.numbers.length;
  $("sliders").replaceChildren();
  for (const n of found.numbers) {
    const label = add($("sliders"), "label", `${n.name} [${n.unit}] `);
    const shown = add(label, "output", n.value.toPrecision(4));
    const slider = add(label, "input", "", { type: "range", name: n.name, min: n.low, max: n.high, step: "any", value: n.value });
    slider.setAttribute("aria-label", n.name);
    slider.addEventListener("input", () => { shown.textContent = Number(slider.value).toPrecision(4); attempt(simulate); });
  }
  await drawRuns(found);
}

async function drawRuns(found) {
  $("runs").replaceChildren();
  runs = [];
  for (const name of [...found.outputs, ...found.inputs]) {
    const rows = await read(await fetch(`api/run?${new URLSearchParams({ name })}`));
    const n = rows.length / (found.inputs.includes(name) ? 2 : 4);
    const part = (k) => rows.subarray(k * n, (k + 1) * n);
    const input = found.inputs.includes(name);
    const series = input ? [{ label: name, stroke: colour("ink") }] : [
      { label: "measured", stroke: colour("ink") }, { label: "before", stroke: colour("before"), dash: [6, 4] },
      { label: "after", stroke: colour("after") }];
    const data = input ? [part(0), part(1)] : [part(0), part(1), part(2), part(3)];
    const chart = plot($("runs"), name, series, data, input ? 90 : 190);
    if (!input) chart.setScale("y", limits(part(1)));
    runs.push({ name, input, chart, data });
  }
}

let wanted = null, working = false;
async function simulate() { // the latest wins: what comes while one is under way replaces what waits
  wanted = Object.fromEntries([...$("sliders").querySelectorAll("input")].map((s) => [s.name, Number(s.value)]));
  if (working) return;
  working = true;
  try {
    while (wanted) {
      const values = wanted;
      wanted = null;
      const found = await call("simulate", { values });
      for (const { name, input, chart, data } of runs) {
        if (input) continue;
        data[3] = found.outputs[name];
        chart.setData(data, false);
        chart.setScale("y", limits(data[1]));
        chart.root.parentElement.querySelector("h3").textContent =
          `${name}: fit ${found.fits[name] === null ? "none" : `${found.fits[name].toFixed(1)} %`}`;
      }
      $("script").textContent = found.script;
    }
  } finally { working = false; }
}

// Controls -----------------------------------------------------------------------------------------------------

function submit(id, action) { $(id).addEventListener("submit", (event) => { event.preventDefault(); attempt(action); }); }
submit("open", async () => show(await call("open", { path: $("path").value }), true));
submit("choose", propose);
submit("columns", diagnose);
$("file").addEventListener("change", () => attempt(() => drop([...$("file").files].map((file) => [file, file.name]))));
$("cancel").addEventListener("click", () => attempt(() => call("cancel", {})));
$("copy").addEventListener("click", () => attempt(() => navigator.clipboard.writeText($("script").textContent)));
for (const kind of ["dragover", "dragleave", "drop"])
  document.addEventListener(kind, (event) => {
    event.preventDefault();
    $("drop").classList.toggle("over", kind === "dragover");
    if (kind !== "drop" || !event.dataTransfer.files.length) return;
    const entries = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry()).filter(Boolean);
    attempt(async () => drop((await Promise.all(entries.map(inside))).flat()));
  });
for (const button of document.querySelectorAll("[data-zoom]"))
  button.addEventListener("click", () => attempt(async () => {
    if (!view) return;
    const [a, b] = view, w = b - a;
    const next = { in: [a + w / 4, b - w / 4], out: [a - w / 2, b + w / 2], left: [a - w / 2, b - w / 2],
      right: [a + w / 2, b + w / 2], all: span }[button.dataset.zoom];
    await zoom(Math.max(next[0], span[0]), Math.min(next[1], span[1]));
  }));
addEventListener("resize", () => {
  for (const { chart } of [...charts, ...runs]) chart.setSize({ width: chart.root.parentElement.clientWidth, height: chart.height });
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => attempt(async () => { // new colours
  await drawSignals();
  if (state.diagnosed) await readAnswer();
}));
attempt(async () => {
  await show(await call("state"), true);
  if (state.job.running) await watch(); else if (state.diagnosed) await readAnswer();
});
