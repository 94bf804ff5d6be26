// The replay of recorded runs: boxes as instances, interpolated between the stored frames in real time.
"use strict";

(() => {
  const recordings = JSON.parse(document.getElementById("recordings").textContent);
  if (recordings.runs.length === 0) return;
  const item = (name) => document.getElementById("replay-" + name);
  const canvas = item("canvas");
  const note = item("note");
  const slider = item("slider");

  function say(text) { note.textContent = text; }

  if (!document.createElement("canvas").getContext("webgl")) {
    say("The replay needs WebGL, which this browser does not support or has disabled. Figure 1 above shows the same runs.");
    return;
  }

  // (rows, width) numbers, each row stored as the difference from the previous one, low bytes first, then high bytes; deflated.
  async function unpack(text, width) {
    const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    const values = new Uint16Array(bytes.length / 2);
    for (let k = 0; k < values.length; ++k) {
      const low = 2 * k - k % width;  // bytes of the rows before, plus the index in this row
      values[k] = (k < width ? 0 : values[k - width]) + (bytes[low] | (bytes[low + width] << 8));
    }
    return values;
  }

  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
  renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(32, 1, 0.1, 5000);
  const sun = new THREE.DirectionalLight(0xffffff, 0.55);
  scene.add(new THREE.HemisphereLight(0xffffff, 0x8890a0, 0.75), sun);
  const controls = new THREE.OrbitControls(camera, canvas);
  Object.assign(controls, { enableKeys: false, enableZoom: false, enablePan: false });
  canvas.addEventListener("focus", () => { controls.enableZoom = true; });
  canvas.addEventListener("blur", () => { controls.enableZoom = false; });
  canvas.addEventListener("pointerdown", () => canvas.focus());

  const cube = new THREE.BoxBufferGeometry(1, 1, 1);
  const edges = new THREE.EdgesGeometry(cube);
  const outlineMaterial = new THREE.ShaderMaterial({
    vertexShader: `attribute vec3 centre, size, tint; varying vec3 shade;
      void main() { shade = tint; gl_Position = projectionMatrix * modelViewMatrix * vec4(centre + position * size, 1.0); }`,
    fragmentShader: "uniform float brightness; varying vec3 shade; void main() { gl_FragColor = vec4(shade * brightness, 1.0); }",
    uniforms: { brightness: { value: 1 } },
  });
  const container = new THREE.LineSegments(edges, new THREE.LineBasicMaterial({ color: 0x8b8f98 }));
  scene.add(container);

  let run = null;  // the recording shown, with its meshes
  let at = 0;  // position in stored frames, with a fraction
  let playing = false;
  let drawn = true;
  let last = 0;

  function meshesOf(count) {
    const instanced = (width) => new THREE.InstancedBufferAttribute(new Float32Array(count * width), width).setUsage(
      THREE.DynamicDrawUsage);
    const tint = instanced(3);
    const geometry = cube.clone().setAttribute("color", tint);
    const solid = new THREE.InstancedMesh(geometry, new THREE.MeshLambertMaterial({ vertexColors: THREE.VertexColors }), count);
    const lines = new THREE.InstancedBufferGeometry();
    lines.setAttribute("position", edges.attributes.position);
    const [centre, size] = [instanced(3), instanced(3)];
    lines.setAttribute("centre", centre).setAttribute("size", size).setAttribute("tint", tint);
    const outlines = new THREE.LineSegments(lines, outlineMaterial);
    solid.frustumCulled = outlines.frustumCulled = false;
    return { solid, outlines, tint, centre, size };
  }

  function frameCamera(low, high) {
    const middle = low.map((x, k) => (x + high[k]) / 2);
    const edge = Math.max(...low.map((x, k) => high[k] - x));
    controls.target.set(...middle);
    const away = 3.25 * edge / Math.min(camera.aspect, 1);
    camera.position.set(0.62, 0.45, 0.8).normalize().multiplyScalar(away).add(controls.target);
    sun.position.set(0.5, 1, 0.8);
    container.position.set(...middle);
    container.scale.set(...low.map((x, k) => high[k] - x));
    controls.update();
  }

  async function load(index) {
    const from = recordings.runs[index];
    say("Loading.");
    const [boxes, overlaps] = [await unpack(from.boxes, 6 * from.objects), await unpack(from.overlaps, from.objects)];
    if (Number(item("scenario").value) !== index) return;  // another one has been chosen in the meantime
    if (run) scene.remove(run.meshes.solid, run.meshes.outlines);
    run = { ...from, boxes, overlaps, meshes: meshesOf(from.objects) };
    scene.add(run.meshes.solid, run.meshes.outlines);
    slider.max = String(run.frames - 1);
    frameCamera(run.low, run.high);
    const left = run.recorded_frames - (run.frames - 1) * run.stride - 1;
    say("");
    item("kept").textContent = `${run.objects.toLocaleString("en")} objects, ${run.frames} frames stored` +
      (run.stride > 1 ? ` (one in ${run.stride})` : "") +
      (left >= run.stride ? `, the first ${((run.frames - 1) * run.stride * run.frame_seconds).toFixed(1)} s of the recording.` : ".");
    seek(0);
  }

  // Sets the current boxes, colours and outlines.
  function place() {
    const { objects: n, boxes, meshes, low, high } = run;
    const before = Math.min(Math.floor(at), run.frames - 1);
    const after = Math.min(before + 1, run.frames - 1);
    const part = at - before;
    const [a, b] = [before * 6 * n, after * 6 * n];
    // The speed since the frame before the nearest one, as in Figure 1.
    const nearest = Math.round(at);
    const to = Math.max(nearest, Math.min(1, run.frames - 1)) * 6 * n;
    const from = Math.max(0, to - 6 * n);
    const step = [0, 1, 2].map((k) => (high[k] - low[k]) / 65535);
    const bySpeed = item("colour").value === "speed";
    const matrices = meshes.solid.instanceMatrix.array;
    const [tint, centre, size] = [meshes.tint.array, meshes.centre.array, meshes.size.array];
    for (let i = 0; i < n; ++i) {
      let squared = 0;
      for (let k = 0; k < 3; ++k) {
        const [lo, hi] = [k * n + i, (k + 3) * n + i];
        const least = boxes[a + lo] + part * (boxes[b + lo] - boxes[a + lo]);
        const most = boxes[a + hi] + part * (boxes[b + hi] - boxes[a + hi]);
        centre[3 * i + k] = matrices[16 * i + 12 + k] = low[k] + (least + most) / 2 * step[k];
        size[3 * i + k] = matrices[16 * i + 5 * k] = (most - least) * step[k];
        const moved = (boxes[to + lo] + boxes[to + hi] - boxes[from + lo] - boxes[from + hi]) / 2 * step[k];
        squared += moved * moved;
      }
      matrices[16 * i + 15] = 1;
      const share = bySpeed ? Math.sqrt(squared) / (run.stride * run.frame_seconds) / run.top_speed
        : run.overlaps[nearest * n + i] / run.top_overlaps;
      const colour = 3 * Math.min(255, Math.max(0, Math.round(share * 255)));
      for (let k = 0; k < 3; ++k) tint[3 * i + k] = recordings.ramp[colour + k] / 255;
    }
    for (const changed of [meshes.solid.instanceMatrix, meshes.tint, meshes.centre, meshes.size]) changed.needsUpdate = true;
    meshes.solid.visible = item("solid").checked;
    meshes.outlines.visible = item("outlines").checked;
    outlineMaterial.uniforms.brightness.value = meshes.solid.visible ? 0.45 : 1;  // darker, to be seen on the boxes
    const frame = nearest * run.stride;
    item("frame").textContent = `frame ${frame} of ${run.recorded_frames - 1} · ${(frame * run.frame_seconds).toFixed(2)} s`;
    item("high").textContent = bySpeed ? `${run.top_speed.toFixed(1)} m/s` : `${run.top_overlaps} overlaps`;
    slider.value = String(nearest);
    slider.setAttribute("aria-valuetext", item("frame").textContent);
  }

  function seek(frame) {
    at = Math.min(Math.max(frame, 0), run.frames - 1);
    drawn = false;
  }

  function play(on) {
    playing = on;
    item("play").textContent = on ? "Pause" : "Play";
    item("play").setAttribute("aria-label", item("play").textContent);
  }

  function tick(now) {
    const seconds = Math.min((now - last) / 1000, 0.25);
    last = now;
    if (run && playing) {
      const next = at + seconds * Number(item("speed").value) / (run.frame_seconds * run.stride);
      seek(next > run.frames - 1 ? 0 : next);
    }
    const { clientWidth: width, clientHeight: height } = canvas;
    if (canvas.dataset.size !== `${width} ${height}`) {
      canvas.dataset.size = `${width} ${height}`;
      renderer.setSize(width, height, false);
      camera.aspect = width / height;
      camera.updateProjectionMatrix();
      drawn = false;
    }
    if (run && !drawn) {
      drawn = true;
      place();
      renderer.render(scene, camera);
      canvas.dataset.drawn = String(Number(canvas.dataset.drawn || 0) + 1);
    }
    requestAnimationFrame(tick);
  }

  // Turns the camera by degrees, and scales its distance by a factor.
  function turn(sideways, upward, factor) {
    const spherical = new THREE.Spherical().setFromVector3(camera.position.clone().sub(controls.target));
    spherical.theta += THREE.Math.degToRad(sideways);
    spherical.phi = Math.min(Math.max(spherical.phi + THREE.Math.degToRad(upward), 0.05), Math.PI - 0.05);
    spherical.radius *= factor;
    camera.position.setFromSpherical(spherical).add(controls.target);
    controls.update();
    drawn = false;
  }

  const keys = {
    " ": () => play(!playing), ",": () => seek(Math.round(at) - 1), ".": () => seek(Math.round(at) + 1),
    ArrowLeft: () => turn(-6, 0, 1), ArrowRight: () => turn(6, 0, 1), ArrowUp: () => turn(0, -6, 1),
    ArrowDown: () => turn(0, 6, 1), "+": () => turn(0, 0, 0.9), "-": () => turn(0, 0, 1.1),
  };
  canvas.addEventListener("keydown", (event) => {
    if (!run || !(event.key in keys)) return;
    event.preventDefault();
    keys[event.key]();
  });

  const ramp = [...Array(17).keys()].map((k) => 3 * Math.round(k * 255 / 16));
  item("ramp").style.background = "linear-gradient(to right," +
    ramp.map((k) => `rgb(${recordings.ramp.slice(k, k + 3).join()})`).join() + ")";
  recordings.runs.forEach((each, k) => item("scenario").append(new Option(each.scenario, String(k))));
  item("scenario").addEventListener("change", (event) => choose(Number(event.target.value)));
  item("play").addEventListener("click", () => play(!playing));
  slider.addEventListener("input", () => { play(false); seek(Number(slider.value)); });
  for (const name of ["colour", "solid", "outlines"]) item(name).addEventListener("change", () => { drawn = false; });
  controls.addEventListener("change", () => { drawn = false; });

  async function choose(index) {
    play(false);
    item("scenario").value = String(index);
    try {
      await load(index);
    } catch (error) {
      say(`The recording cannot be unpacked: ${error.message}`);
      throw error;
    }
  }

  // A key frame of Figure 1 moves the replay to its frame.
  for (const button of document.querySelectorAll("[data-key-frame]")) {
    button.addEventListener("click", async () => {
      const index = recordings.runs.findIndex((each) => each.scenario === button.dataset.scenario);
      await choose(index);
      seek(Math.round(Number(button.dataset.keyFrame) / run.stride));
      document.getElementById("replay").scrollIntoView({ block: "nearest" });
    });
  }
  choose(0);
  requestAnimationFrame(tick);
})();
