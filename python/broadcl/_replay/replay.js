// The replay of recorded runs, and the key frames of Figure 1 of a study: shaded boxes on canvases, the farthest first.
// A run has `objects` boxes in each of `frames` stored frames, one in `stride` of those recorded. Its lists, which pack() of
// _replay packed, are of uint16 or uint32: `boxes` in levels between `low` and `high`, for each frame the lower x of all, then
// the lower y, ...; `overlaps` of each. If it has a `curve`, it also has `filters`, for each frame the groups of all, then masks,
// bodies and worlds; `ids`; `partners` of the first box in each frame, then of the second, ..., the first `most_partners`; and
// pairs, added and removed of each frame, or the most of `frames_per_point` frames; most boxes are between the corners of `focus`.
"use strict";

(() => {
  const runs = JSON.parse(document.getElementById("recordings").textContent);
  const item = (name) => document.getElementById("replay-" + name);
  const [canvas, slider, curve] = [item("canvas"), item("slider"), item("curve")];
  const absent = 65535;
  const lights = [0.8, 1, 0.6, 0.35];  // of faces towards x, y and z, and of edges
  const viridis = ["440154", "481567", "482677", "453781", "404788", "39568c", "33638d", "2d708e", "287d8e", "238a8d", "1f968b",
    "20a387", "29af7f", "3cbb75", "55c667", "73d055", "95d840", "b8de29", "dce319", "fde725"].map((c) =>
    [0, 2, 4].map((k) => parseInt(c.slice(k, k + 2), 16)));
  const ramp = lights.map((light) => Array.from({ length: 256 }, (_, c) => {
    const [x, k] = [c / 255 * (viridis.length - 1), Math.min(Math.floor(c / 255 * (viridis.length - 1)), viridis.length - 2)];
    return `rgb(${viridis[k].map((from, j) => Math.round((from + (x - k) * (viridis[k + 1][j] - from)) * light)).join()})`;
  }));
  const hues = lights.map((light) => Array.from({ length: 24 }, (_, c) =>
    `hsl(${Math.round(211 + 137.508 * c) % 360},${c % 3 === 1 ? 45 : 65}%,${(c % 2 ? 48 : 62) * light}%)`));
  const filters = ["group", "mask", "body", "world"];
  const startView = { theta: 0.66, phi: 1.15, distance: 3.25 };  // angles, and the distance in edges of the world
  const flatView = { theta: 0, phi: Math.PI / 2, distance: 2.2 };
  let [run, view, at, playing, drawn, last, selected] = [null, null, 0, false, true, 0, -1];  // at: in stored frames, with a fraction

  const whole = (x) => x.toLocaleString("en");
  const counted = (x, noun) => `${whole(x)} ${noun}${x === 1 ? "" : noun === "box" ? "es" : "s"}`;
  const middleOf = (from) => from.focus?.[0].map((x, k) => (x + from.focus[1][k]) / 2);
  const isFlat = (from) => from.low[2] === from.high[2];

  async function unpack(text, Numbers, width) {
    const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const numbers = new Numbers(await new Response(stream).arrayBuffer());
    for (let k = width; k < numbers.length; ++k) numbers[k] += numbers[k - width];
    return numbers;
  }

  async function load(from) {
    if (typeof from.boxes !== "string") return from;
    const n = from.objects;
    const lists = { boxes: [Uint16Array, 6 * n], overlaps: [Uint16Array, n], filters: [Uint32Array, 4 * n],
      ids: [Uint32Array, n], partners: [Uint32Array, Infinity], curve: [Uint32Array, 3] };
    const names = Object.keys(lists).filter((name) => name in from);
    const loaded = await Promise.all(names.map((name) => unpack(from[name], ...lists[name])));
    names.forEach((name, k) => { from[name] = loaded[k]; });
    if (from.curve) {
      from.rows = new Map(Array.from(from.ids, (id, i) => [id, i]));
      from.begins = new Uint32Array(from.overlaps.length + 1);  // of the partners of each box in each frame
      for (let k = 0; k < from.overlaps.length; ++k) {
        const count = from.overlaps[k % from.frames * n + Math.floor(k / from.frames)];
        from.begins[k + 1] = from.begins[k] + Math.min(count, from.most_partners);
      }
    }
    return from;
  }

  const filterOf = (from, frame, name, i) => from.filters[(4 * frame + filters.indexOf(name)) * from.objects + i];
  const partnersOf = (from, frame, i) => {
    const k = i * from.frames + frame;
    return Array.from(from.partners.subarray(from.begins[k], from.begins[k + 1]));
  };
  const filterText = (name, value) => (value === 0xffffffff ? { mask: "all", body: "none", world: "all" }[name] : null) ?? String(value);

  // The values of a filter that there are, each with its colour.
  function categories(from, name) {
    from.categories ??= {};
    if (!from.categories[name]) {
      const [values, n, column] = [new Set(), from.objects, filters.indexOf(name)];
      for (let f = 0; f < from.frames; ++f) {
        from.filters.subarray((4 * f + column) * n, (4 * f + column + 1) * n).forEach((x) => values.add(x));
      }
      from.categories[name] = new Map([...values].sort((x, y) => x - y).map((x, k) => [x, k % hues[0].length]));
    }
    return from.categories[name];
  }

  // Colours of the boxes of a frame: for each face and the edges a list, and the index into it of box i.
  function tints(from, nearest, name) {
    const n = from.objects;
    if (name === "overlaps") {
      const of = (i) => Math.min(255, Math.round(from.overlaps[nearest * n + i] / from.top_overlaps * 255));
      return [ramp, of];
    }
    if (name !== "speed") {
      const colours = categories(from, name);
      return [hues, (i) => colours.get(filterOf(from, nearest, name, i))];
    }
    const to = Math.max(nearest, Math.min(1, from.frames - 1)) * 6 * n;  // the speed is that since the frame before this one
    const since = Math.max(0, to - 6 * n);
    const doubled = (start, k, i) => from.boxes[start + k * n + i] + from.boxes[start + (k + 3) * n + i];
    const metres = from.low.map((x, k) => (from.high[k] - x) / from.levels);
    const moved = (k, i) => (doubled(to, k, i) - doubled(since, k, i)) / 2 * metres[k];
    const second = from.stride * from.frame_seconds * from.top_speed;
    return [ramp, (i) => Math.min(255, Math.round(Math.hypot(moved(0, i), moved(1, i), moved(2, i)) / second * 255))];
  }

  // What is seen on a canvas: how points are projected, and the boxes, the farthest first.
  function look(target, from, position, eyes, up) {
    const scale = Math.min(window.devicePixelRatio, 2);
    const [w, h] = [target.clientWidth, target.clientHeight].map((x) => Math.round(x * scale));
    const axes = up === "z" ? [1, 2, 0] : [0, 1, 2];
    const [low, high] = [axes.map((k) => from.low[k]), axes.map((k) => from.high[k])];
    const { objects: n, boxes } = from;
    const size = low.map((x, k) => high[k] - x);
    const middle = eyes.middle ? axes.map((k) => eyes.middle[k]) : low.map((x, k) => (x + high[k]) / 2);
    const [sin, cos, sine, cosine] = [Math.sin(eyes.theta), Math.cos(eyes.theta), Math.sin(eyes.phi), Math.cos(eyes.phi)];
    const distance = eyes.distance * (Math.max(...size) || 1) / Math.min(w / h, 1);
    const eye = [sine * sin, cosine, sine * cos].map((x, k) => middle[k] + distance * x);
    const lens = h / 2 / Math.tan(0.28);
    const nearest = distance * 1e-3;
    const project = ([x, y, away]) => [w / 2 + lens * x / away, h / 2 - lens * y / away];
    const turned = (x, y, z) => {
      [x, y, z] = [x - eye[0], y - eye[1], z - eye[2]];
      return [x * cos - z * sin, y * sine - cosine * (x * sin + z * cos), -(x * sine * sin + y * cosine + z * sine * cos)];
    };
    // The corner with bit k is on the upper side of axis k.
    const corners = (lo, hi) => [0, 1, 2, 3, 4, 5, 6, 7].map((c) =>
      turned(c & 1 ? hi[0] : lo[0], c & 2 ? hi[1] : lo[1], c & 4 ? hi[2] : lo[2]));
    // The side of a box, as far as it is in front of the eye.
    const side = (all, k, upper) => {
      const points = [0, 1 << (k + 1) % 3, (1 << (k + 1) % 3) + (1 << (k + 2) % 3), 1 << (k + 2) % 3].map((c) =>
        all[c + (upper ? 1 << k : 0)]);
      if (points.every((p) => p[2] >= nearest)) return points.map(project);
      return points.flatMap((p, j) => {
        const q = points[(j + 1) % 4];
        const share = (nearest - p[2]) / (q[2] - p[2]);
        const ends = p[2] < nearest ? [] : [p];
        if (p[2] < nearest !== q[2] < nearest) ends.push(p.map((x, m) => x + share * (q[m] - x)));
        return ends.map(project);
      });
    };

    const before = Math.min(Math.floor(position), from.frames - 1);
    const [a, b] = [before * 6 * n, Math.min(before + 1, from.frames - 1) * 6 * n];
    const unit = size.map((x) => x / from.levels);
    const bound = (k, i, share) => {
      const column = (axes[k % 3] + (k < 3 ? 0 : 3)) * n + i;
      return low[k % 3] + unit[k % 3] * (boxes[a + column] + share * (boxes[b + column] - boxes[a + column]));
    };
    const shown = [];
    for (let i = 0; i < n; ++i) {
      if (boxes[a + i] === absent) continue;
      const share = boxes[b + i] === absent ? 0 : position - before;
      const lo = [bound(0, i, share), bound(1, i, share), bound(2, i, share)];
      const hi = [bound(3, i, share), bound(4, i, share), bound(5, i, share)];
      const away = Math.hypot((lo[0] + hi[0]) / 2 - eye[0], (lo[1] + hi[1]) / 2 - eye[1], (lo[2] + hi[2]) / 2 - eye[2]);
      const pixels = lens * Math.hypot(hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]) / away;
      // Walls and the ground would hide the rest.
      const spans = (k) => boxes[a + k * n + i] === 0 && boxes[a + (k + 3) * n + i] === from.levels;
      const hollow = n > 1 && spans(0) + spans(1) + spans(2) > 1;
      shown.push({ i, lo, hi, away, pixels, hollow });
    }
    shown.sort((x, y) => y.away - x.away);
    return { scale, w, h, eye, project, corners, side, world: corners(low, high), axes, shown };
  }

  const isSeen = ({ lo, hi }, eye, k) => eye[k] < lo[k] || eye[k] > hi[k];  // one of its faces towards axis k

  function draw(target, from, position, eyes, { colour = "speed", solid = true, outlines = false, up = "y", chosen = -1 }) {
    const { scale, w, h, eye, project, corners, side, world, axes, shown } = look(target, from, position, eyes, up);
    Object.assign(target, { width: w, height: h });  // which also clears it
    const context = target.getContext("2d");
    const path = (points) => {
      context.beginPath();
      points.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.closePath();
    };
    context.lineWidth = 0.8 * scale;
    context.strokeStyle = context.fillStyle = "#8b8f98";
    for (let k = 0; k < 6; ++k) { path(side(world, k >> 1, k & 1)); context.stroke(); }
    if (from.curve) {
      context.font = `${12 * scale}px system-ui, sans-serif`;
      [1, 2, 4].forEach((c, k) => {
        const [x, y] = project(world[c]);
        if (from.low[axes[k]] < from.high[axes[k]] && world[c][2] > 0) context.fillText("xyz"[axes[k]], x + 4 * scale, y + 12 * scale);
      });
    }

    const nearest = Math.round(position);
    const [shades, tint] = tints(from, nearest, colour);
    const partners = chosen < 0 ? new Set() : new Set(partnersOf(from, nearest, chosen).map((id) => from.rows.get(id)));
    const marked = [];
    for (const box of shown) {
      const [all, c] = [corners(box.lo, box.hi), tint(box.i)];
      if (box.i === chosen || partners.has(box.i)) marked.push([box, all]);
      else if (chosen >= 0) context.globalAlpha = 0.15;
      const small = box.pixels < 2 * scale;
      if (small && all[0][2] > 0) {
        const [x, y] = project(all[0]);
        context.fillStyle = shades[1][c];
        context.fillRect(x - scale, y - scale, 2 * scale, 2 * scale);
      }
      for (let k = 0; k < 3 && !small; ++k) {
        if (!isSeen(box, eye, k)) continue;
        path(side(all, k, eye[k] > box.hi[k]));
        context.fillStyle = shades[isFlat(from) ? 1 : k][c];
        const fills = solid && !box.hollow;
        context.strokeStyle = outlines ? shades[fills ? 3 : 1][c] : context.fillStyle;  // otherwise gaps would be seen
        if (fills) context.fill();
        if (solid || outlines) context.stroke();
      }
      context.globalAlpha = 1;
    }
    for (const [box, all] of marked) {
      context.lineWidth = (box.i === chosen ? 2.5 : 1.5) * scale;
      context.strokeStyle = box.i === chosen ? "#e6007a" : "#ff8c1a";
      for (let k = 0; k < 6; ++k) { path(side(all, k >> 1, k & 1)); context.stroke(); }
    }
  }

  // The box that is seen at a point of the canvas, in pixels of the page.
  function pick(px, py) {
    const { scale, eye, project, corners, side, shown } = look(canvas, run, at, view, item("up").value);
    const [x, y] = [px * scale, py * scale];
    const contains = (points) => {
      const sides = points.map(([x0, y0], k) => {
        const [x1, y1] = points[(k + 1) % points.length];
        return (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0);
      });
      return sides.length > 0 && (sides.every((x) => x >= 0) || sides.every((x) => x <= 0));
    };
    for (const box of shown.reverse()) {
      if (box.hollow) continue;
      const all = corners(box.lo, box.hi);
      const [[x0, y0], [x1, y1]] = [project(all[0]), project(all[7])];
      if (all[0][2] > 0 && Math.hypot((x0 + x1) / 2 - x, (y0 + y1) / 2 - y) < 3 * scale) return box.i;
      for (let k = 0; k < 3; ++k) {
        if (isSeen(box, eye, k) && contains(side(all, k, eye[k] > box.hi[k]))) return box.i;
      }
    }
    return -1;
  }

  const frameNumber = () => Math.round(at * run.stride);

  // The bounds of a box, unless it is absent.
  function boxOf(frame, row) {
    const levels = [0, 1, 2, 3, 4, 5].map((k) => run.boxes[(6 * frame + k) * run.objects + row]);
    if (levels[0] === absent) return null;
    return levels.map((level, k) => run.low[k % 3] + level * (run.high[k % 3] - run.low[k % 3]) / run.levels);
  }

  function select(row) {
    if (!run.curve) return;
    selected = row;
    item("id").value = row < 0 ? "" : String(run.ids[row]);
    drawn = false;
  }

  function describe() {
    const nearest = Math.round(at);
    item("details").replaceChildren();
    if (selected < 0) {
      item("details").append("Click a box to see its id, its filter and its partners; double-click it to turn around it; Escape ends both.");
      return;
    }
    const n = run.objects;
    const say = (text) => item("details").append(text);
    const id = document.createElement("b");
    id.textContent = `Object ${run.ids[selected]}`;
    item("details").append(id);
    say(filters.map((name) => `${name} ${filterText(name, filterOf(run, nearest, name, selected))}`).join(", ").replace(/^/, ": "));
    const frame = Math.round(nearest * run.stride);
    const box = boxOf(nearest, selected);
    if (!box) return say(`. It has no box in frame ${frame}.`);
    const digits = box.map((x) => Number(x.toPrecision(4)));
    say(`. Box of about (${digits.slice(0, 3).join(", ")}) to (${digits.slice(3).join(", ")}). `);
    const [found, count] = [partnersOf(run, nearest, selected), run.overlaps[nearest * n + selected]];
    say(`${counted(count, "partner")} in frame ${frame}${count ? ":" : "."} `);
    for (const partner of found) {
      const row = run.rows.get(partner);
      const shown = document.createElement(row === undefined ? "span" : "button");
      shown.textContent = String(partner);
      if (row === undefined) shown.title = "not in the sample that is shown";
      else shown.addEventListener("click", () => select(row));
      item("details").append(shown, " ");
    }
    if (count > found.length) say(`and ${whole(count - found.length)} more`);
  }

  // Pairs as a line, and below it what was added (upwards) and removed (downwards).
  function drawCurve() {
    const scale = Math.min(window.devicePixelRatio, 2);
    const [w, h] = [curve.clientWidth, curve.clientHeight].map((x) => Math.round(x * scale));
    Object.assign(curve, { width: w, height: h });
    const context = curve.getContext("2d");
    const points = run.curve.length / 3;
    const most = [0, 0, 0];
    const columns = Array.from({ length: w }, (_, x) => {
      const top = [0, 0, 0];
      const end = Math.max(Math.ceil((x + 1) / w * points), Math.floor(x / w * points) + 1);
      for (let p = Math.floor(x / w * points); p < end; ++p) {
        for (let k = 0; k < 3; ++k) {
          top[k] = Math.max(top[k], run.curve[3 * p + k]);
          // (All pairs are new in the first frame.)
          if (k === 0 || p > 0 || points === 1) most[k] = Math.max(most[k], run.curve[3 * p + k]);
        }
      }
      return top;
    });
    const changes = Math.max(most[1], most[2]);
    const ground = 0.5 * h;
    const middle = (ground + 16 * scale + h) / 2;
    context.fillStyle = "#4e79c4";
    columns.forEach(([pairs], x) => {
      const height = pairs / Math.max(most[0], 1) * (ground - 16 * scale);
      context.fillRect(x, ground - height, 1, Math.max(height, scale));
    });
    columns.forEach(([, added, removed], x) => {
      const [up, down] = [added, removed].map((count) => Math.min(count / Math.max(changes, 1), 1) * (h - middle - 2 * scale));
      context.fillStyle = "#2e9e5b";
      context.fillRect(x, middle - up, 1, up);
      context.fillStyle = "#d1495b";
      context.fillRect(x, middle, 1, down);
    });
    context.fillStyle = getComputedStyle(curve).color;
    context.fillRect(0, middle, w, 1);
    context.font = `${11 * scale}px system-ui, sans-serif`;
    context.fillText(`pairs, up to ${whole(most[0])}`, 6 * scale, 12 * scale);
    context.fillText(`added and removed, up to ${whole(changes)}`, 6 * scale, ground + 12 * scale);
    const x = (frameNumber() + 0.5) / run.recorded_frames * w;
    context.fillRect(Math.round(x) - scale, 0, 2 * scale, h);
  }

  function seek(frame) {
    at = Math.min(Math.max(frame, 0), run.frames - 1);
    drawn = false;
  }

  function play(on) {
    playing = on;
    item("play").textContent = on ? "Pause" : "Play";
  }

  function showFrame() {
    const colour = item("colour").value;
    const [solid, outlines] = [item("solid").checked, item("outlines").checked];
    draw(canvas, run, at, view, { colour, solid, outlines, up: item("up").value, chosen: selected });
    const frame = frameNumber();
    let said = `${(frame * run.frame_seconds).toFixed(2)} s`;
    if (run.curve) {
      const [pairs, added, removed] = run.curve.subarray(3 * Math.floor(frame / run.frames_per_point));
      said = `${counted(pairs, "pair")}, ${whole(added)} added, ${whole(removed)} removed`;
      describe();
      if (!curve.hidden) drawCurve();
    }
    item("frame").textContent = `frame ${frame} of ${run.recorded_frames - 1} · ${said}`;
    slider.value = String(Math.round(at));
    canvas.dataset.drawn = String(Number(canvas.dataset.drawn || 0) + 1);
  }

  function showRamp() {
    const colour = item("colour").value;
    const swatch = (name, background) => {
      const colours = document.createElement("i");
      Object.assign(colours, { className: name });
      colours.style.background = background;
      return colours;
    };
    if (filters.includes(colour)) {
      const all = [...categories(run, colour)];
      item("ramp").replaceChildren(`${colour} `, ...all.slice(0, 8).flatMap(([value, c]) =>
        [swatch("swatch", hues[1][c]), `${filterText(colour, value)} `]), all.length > 8 ? `and ${whole(all.length - 8)} more` : "");
    } else {
      const top = colour === "speed" ? `${run.top_speed.toFixed(1)} m/s` : counted(run.top_overlaps, "overlap");
      item("ramp").replaceChildren("0", swatch("colours", `linear-gradient(to right, ${ramp[1].join()})`), top);
    }
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
      showFrame();
    }
    requestAnimationFrame(tick);
  }

  function turn(sideways, upward, factor) {
    const phi = Math.min(Math.max(view.phi + upward, 0.05), 3.09);
    view = { ...view, theta: view.theta + sideways, phi, distance: view.distance * factor };
    drawn = false;
  }

  function keptText() {
    const { objects, all_objects: all, frames, recorded_frames: recorded, stride } = run;
    if (!run.curve) {
      const [kept, seconds] = [(frames - 1) * stride, recorded - 1].map((x) => (x * run.frame_seconds).toFixed(1));
      return `${counted(objects, "object")}, ${kept} of ${seconds} s${stride > 1 ? `, one in ${stride} frames stored, between which boxes are interpolated` : ""}.`;
    }
    const some = objects < all ? `, of which a random sample of ${whole(objects)} is shown; counts and partners are of all` : "";
    return `${counted(all, "object")}${some}; ${counted(recorded, "frame")}${
      frames < recorded ? `, of which ${whole(frames)} are stored; between these, boxes are interpolated` : ""}.`;
  }

  async function choose(index) {
    play(false);
    item("scenario").value = String(index);
    const loaded = await load(runs[index]);
    if (Number(item("scenario").value) !== index) return;  // another one has been chosen in the meantime
    [run, view, selected] = [loaded, { ...(isFlat(loaded) ? flatView : startView), middle: middleOf(loaded) }, -1];
    if (run.focus) {
      const [most, all] = [run.focus, [run.low, run.high]].map(([low, high]) => Math.max(...high.map((x, k) => x - low[k])));
      view.distance *= Math.min(1, 1.15 * most / (all || 1)) || 1;
    }
    const colour = item("colour").value;
    item("colour").replaceChildren(...run.colours.map((name) => new Option(name)));
    if (run.colours.includes(colour)) item("colour").value = colour;
    slider.max = String(run.frames - 1);
    for (const name of ["details", "choice"]) item(name).hidden = !run.curve;
    curve.hidden = !run.curve || run.recorded_frames < 2;
    item("time").hidden = run.frames < 2;
    item("kept").textContent = keptText();
    showRamp();
    seek(0);
  }

  const keys = {
    " ": () => play(!playing), ",": () => seek(Math.round(at) - 1), ".": () => seek(Math.round(at) + 1),
    ArrowLeft: () => turn(-0.1, 0, 1), ArrowRight: () => turn(0.1, 0, 1), ArrowUp: () => turn(0, -0.1, 1),
    ArrowDown: () => turn(0, 0.1, 1), "+": () => turn(0, 0, 0.9), "-": () => turn(0, 0, 1.1), Escape: () => { view.middle = middleOf(run); select(-1); },
  };
  canvas.addEventListener("keydown", (event) => {
    if (!run || !(event.key in keys)) return;
    event.preventDefault();
    keys[event.key]();
  });
  let pressed = [0, 0];
  canvas.addEventListener("pointerdown", (event) => {
    canvas.focus();
    canvas.setPointerCapture(event.pointerId);
    pressed = [event.clientX, event.clientY];
  });
  canvas.addEventListener("pointermove", (event) => event.buttons && turn(-event.movementX / 150, -event.movementY / 150, 1));
  canvas.addEventListener("pointerup", (event) => {
    if (run?.curve && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4) select(pick(event.offsetX, event.offsetY));
  });
  canvas.addEventListener("dblclick", () => {
    const box = selected < 0 ? null : boxOf(Math.round(at), selected);
    if (box) view.middle = [0, 1, 2].map((k) => (box[k] + box[k + 3]) / 2);
    drawn = false;
  });
  canvas.addEventListener("wheel", (event) => {
    if (document.activeElement !== canvas) return;  // the page scrolls
    event.preventDefault();
    turn(0, 0, event.deltaY > 0 ? 1.1 : 0.9);
  });
  const jump = (event) => {
    play(false);
    seek(Math.floor(event.offsetX / curve.clientWidth * run.recorded_frames) / run.stride);
  };
  curve.addEventListener("pointerdown", (event) => { curve.setPointerCapture(event.pointerId); jump(event); });
  curve.addEventListener("pointermove", (event) => event.buttons && jump(event));
  item("id").addEventListener("change", ({ target }) => {
    const row = target.value === "" ? -1 : run.rows.get(Number(target.value));
    target.setCustomValidity(row === undefined ? "There is no such object, or it is not in the sample that is shown." : "");
    if (target.reportValidity()) select(row);
  });
  item("nearer").addEventListener("click", () => turn(0, 0, 0.8));
  item("farther").addEventListener("click", () => turn(0, 0, 1.25));
  runs.forEach((each, k) => item("scenario").append(new Option(each.scenario, String(k))));
  item("scenario").parentElement.hidden = runs.length < 2;
  item("scenario").addEventListener("change", (event) => choose(Number(event.target.value)));
  item("play").addEventListener("click", () => play(!playing));
  slider.addEventListener("input", () => { play(false); seek(Number(slider.value)); });
  for (const name of ["solid", "outlines", "up"]) item(name).addEventListener("change", () => { drawn = false; });
  item("colour").addEventListener("change", () => { showRamp(); drawn = false; });
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
