// The replay of recorded runs, and the key frames of Figure 1: shaded boxes on canvases, the farthest first.
"use strict";

(() => {
  const { runs, ramp } = JSON.parse(document.getElementById("recordings").textContent);
  const item = (name) => document.getElementById("replay-" + name);
  const [canvas, slider] = [item("canvas"), item("slider")];
  const shades = [0.8, 1, 0.6, 0.35].map((light) =>  // of faces towards x, y and z, and of edges
    Array.from({ length: 256 }, (_, c) => `rgb(${ramp.slice(3 * c, 3 * c + 3).map((x) => Math.round(x * light)).join()})`));
  const startView = { theta: 0.66, phi: 1.15, distance: 3.25 };  // angles, and the distance in edges of the world
  let [run, view, at, playing, drawn, last] = [null, { ...startView }, 0, false, true, 0];  // at: in stored frames, with a fraction

  async function unpack(text) {
    const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint16Array(await new Response(stream).arrayBuffer());
  }

  async function load(from) {
    if (typeof from.boxes === "string") [from.boxes, from.overlaps] = await Promise.all([from.boxes, from.overlaps].map(unpack));
    return from;
  }

  function draw(target, from, position, eyes, { bySpeed = true, solid = true, outlines = false }) {
    const scale = Math.min(window.devicePixelRatio, 2);
    const [w, h] = [target.clientWidth, target.clientHeight].map((x) => Math.round(x * scale));
    Object.assign(target, { width: w, height: h });  // which also clears it
    const context = target.getContext("2d");
    const { objects: n, boxes, low, high } = from;
    const [size, middle] = [low.map((x, k) => high[k] - x), low.map((x, k) => (x + high[k]) / 2)];
    const [sin, cos, sine, cosine] = [Math.sin(eyes.theta), Math.cos(eyes.theta), Math.sin(eyes.phi), Math.cos(eyes.phi)];
    const distance = eyes.distance * Math.max(...size) / Math.min(w / h, 1);
    const eye = [sine * sin, cosine, sine * cos].map((x, k) => middle[k] + distance * x);
    const lens = h / 2 / Math.tan(0.28);
    const project = (x, y, z) => {
      [x, y, z] = [x - eye[0], y - eye[1], z - eye[2]];
      const away = -(x * sine * sin + y * cosine + z * sine * cos);
      return [w / 2 + lens * (x * cos - z * sin) / away, h / 2 - lens * (y * sine - cosine * (x * sin + z * cos)) / away];
    };
    // The corner with bit k is on the upper side of axis k.
    const corners = (lo, hi) => [...Array(8).keys()].map((c) => project(...lo.map((x, k) => (c >> k & 1 ? hi[k] : x))));
    const path = (points) => {
      context.beginPath();
      points.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.closePath();
    };
    const face = (all, k, upper) => [0, 1 << (k + 1) % 3, (1 << (k + 1) % 3) + (1 << (k + 2) % 3), 1 << (k + 2) % 3].map((c) =>
      all[c + (upper ? 1 << k : 0)]);

    context.lineWidth = 0.8 * scale;
    context.strokeStyle = "#8b8f98";
    const world = corners(low, high);
    for (let k = 0; k < 6; ++k) { path(face(world, k >> 1, k & 1)); context.stroke(); }

    const before = Math.min(Math.floor(position), from.frames - 1);
    const [a, b] = [before * 6 * n, Math.min(before + 1, from.frames - 1) * 6 * n];
    const nearest = Math.round(position);  // the speed is that since the frame before this one
    const to = Math.max(nearest, Math.min(1, from.frames - 1)) * 6 * n;
    const since = Math.max(0, to - 6 * n);
    const metres = size.map((x) => x / from.levels);
    const bound = (k, i) => low[k % 3] + metres[k % 3] *
      (boxes[a + k * n + i] + (position - before) * (boxes[b + k * n + i] - boxes[a + k * n + i]));
    const doubled = (start, k, i) => boxes[start + k * n + i] + boxes[start + (k + 3) * n + i];
    const moved = (k, i) => (doubled(to, k, i) - doubled(since, k, i)) / 2 * metres[k];
    const shown = Array.from({ length: n }, (_, i) => {
      const [lo, hi] = [[0, 1, 2].map((k) => bound(k, i)), [3, 4, 5].map((k) => bound(k, i))];
      const speed = Math.hypot(moved(0, i), moved(1, i), moved(2, i)) / (from.stride * from.frame_seconds);
      const share = bySpeed ? speed / from.top_speed : from.overlaps[nearest * n + i] / from.top_overlaps;
      const away = Math.hypot(...lo.map((x, k) => (x + hi[k]) / 2 - eye[k]));
      return { lo, hi, away, colour: Math.min(255, Math.round(share * 255)) };
    });
    for (const { lo, hi, colour } of shown.sort((x, y) => y.away - x.away)) {
      const all = corners(lo, hi);
      for (let k = 0; k < 3; ++k) {
        if (eye[k] >= lo[k] && eye[k] <= hi[k]) continue;  // neither side can be seen
        path(face(all, k, eye[k] > hi[k]));
        context.fillStyle = shades[k][colour];
        context.strokeStyle = outlines ? shades[solid ? 3 : 1][colour] : context.fillStyle;  // otherwise gaps would be seen
        if (solid) context.fill();
        if (solid || outlines) context.stroke();
      }
    }
  }

  function seek(frame) {
    at = Math.min(Math.max(frame, 0), run.frames - 1);
    drawn = false;
  }

  function play(on) {
    playing = on;
    item("play").textContent = on ? "Pause" : "Play";
  }

  function tick(now) {
    const seconds = Math.min((now - last) / 1000, 0.25);
    last = now;
    if (run && playing) {
      const next = at + seconds * Number(item("speed").value) / (run.frame_seconds * run.stride);
      seek(next > run.frames - 1 ? 0 : next);
    }
    if (run && !drawn) {
      drawn = true;
      const bySpeed = item("colour").value === "speed";
      draw(canvas, run, at, view, { bySpeed, solid: item("solid").checked, outlines: item("outlines").checked });
      const frame = Math.round(at) * run.stride;
      item("frame").textContent = `frame ${frame} of ${run.recorded_frames - 1} · ${(frame * run.frame_seconds).toFixed(2)} s`;
      item("high").textContent = bySpeed ? `${run.top_speed.toFixed(1)} m/s` : `${run.top_overlaps} overlaps`;
      slider.value = String(Math.round(at));
      canvas.dataset.drawn = String(Number(canvas.dataset.drawn || 0) + 1);
    }
    requestAnimationFrame(tick);
  }

  function turn(sideways, upward, factor) {
    const phi = Math.min(Math.max(view.phi + upward, 0.05), 3.09);
    view = { theta: view.theta + sideways, phi, distance: view.distance * factor };
    drawn = false;
  }

  async function choose(index) {
    play(false);
    item("scenario").value = String(index);
    const loaded = await load(runs[index]);
    if (Number(item("scenario").value) !== index) return;  // another one has been chosen in the meantime
    [run, view] = [loaded, { ...startView }];
    slider.max = String(run.frames - 1);
    const [kept, whole] = [(run.frames - 1) * run.stride, run.recorded_frames - 1].map((x) => (x * run.frame_seconds).toFixed(1));
    item("kept").textContent = `${run.objects.toLocaleString("en")} objects, ${kept} of ${whole} s` +
      `${run.stride > 1 ? `, one in ${run.stride} frames stored` : ""}.`;
    seek(0);
  }

  const keys = {
    " ": () => play(!playing), ",": () => seek(Math.round(at) - 1), ".": () => seek(Math.round(at) + 1),
    ArrowLeft: () => turn(-0.1, 0, 1), ArrowRight: () => turn(0.1, 0, 1), ArrowUp: () => turn(0, -0.1, 1),
    ArrowDown: () => turn(0, 0.1, 1), "+": () => turn(0, 0, 0.9), "-": () => turn(0, 0, 1.1),
  };
  canvas.addEventListener("keydown", (event) => {
    if (!run || !(event.key in keys)) return;
    event.preventDefault();
    keys[event.key]();
  });
  canvas.addEventListener("pointerdown", (event) => { canvas.focus(); canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => event.buttons && turn(-event.movementX / 150, -event.movementY / 150, 1));
  canvas.addEventListener("wheel", (event) => {
    if (document.activeElement !== canvas) return;  // the page scrolls
    event.preventDefault();
    turn(0, 0, event.deltaY > 0 ? 1.1 : 0.9);
  });
  item("ramp").style.background = `linear-gradient(to right, ${shades[1].join()})`;
  runs.forEach((each, k) => item("scenario").append(new Option(each.scenario, String(k))));
  item("scenario").addEventListener("change", (event) => choose(Number(event.target.value)));
  item("play").addEventListener("click", () => play(!playing));
  slider.addEventListener("input", () => { play(false); seek(Number(slider.value)); });
  for (const name of ["colour", "solid", "outlines"]) item(name).addEventListener("change", () => { drawn = false; });
  window.addEventListener("resize", () => { drawn = false; });
  for (const button of document.querySelectorAll("[data-key-frame]")) {
    const [index, frame] = [Number(button.dataset.run), Number(button.dataset.keyFrame)];
    load(runs[index]).then((from) => draw(button.firstElementChild, from, frame, startView, {}));
    button.addEventListener("click", async () => {
      await choose(index);
      seek(frame);
      document.getElementById("replay").scrollIntoView({ block: "nearest" });
    });
  }
  choose(0);
  requestAnimationFrame(tick);
})();
