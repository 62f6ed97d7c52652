/* The 3-D view of an asset: a slider for every joint, parts that can be dragged.
   Data: see viewer.py. Poses are computed as in asset.py: every link moves with its parent and
   by its own joint, whose axis and pivot are given in the object frame with every joint at 0. */
(() => {
  "use strict";
  const root = document.getElementById("viewer");
  const content = JSON.parse(document.getElementById("viewer-data").textContent);
  const canvas = root.querySelector("canvas");
  const radians = Math.PI / 180;

  // Kinematics: one group for each link, whose matrix is what its joint does from 0 on.
  const scene = new THREE.Scene();
  const links = new Map(), joints = new Map(), jointOf = new Map(), q = new Map();
  const leaderOf = new Map(content.followers.map((f) => [f.joint, f.leader]));
  for (const link of content.links) {
    const group = new THREE.Group();
    group.matrixAutoUpdate = false;
    (links.get(link.parent)?.group ?? scene).add(group);
    links.set(link.name, { group, parent: link.parent, T_ol: new THREE.Matrix4().set(...link.T_ol) });
  }
  for (const joint of content.joints) {
    joints.set(joint.name, joint);
    jointOf.set(joint.link, joint.name);
    q.set(joint.name, joint.closed);
  }

  function motion(joint, value, out) {
    const axis = new THREE.Vector3(...joint.axis);
    if (joint.kind === "slide") return out.makeTranslation(...axis.multiplyScalar(value).toArray());
    const pivot = new THREE.Vector3(...joint.pivot);
    out.makeRotationAxis(axis, value);
    return out.setPosition(pivot.clone().sub(pivot.clone().applyMatrix4(out)));
  }

  function place(values) {
    for (const [name, value] of Object.entries(values)) q.set(name, value);
    for (const f of content.followers) {
      const x = q.get(f.leader) ?? 0;
      q.set(f.joint, f.coefficients.reduceRight((sum, c) => sum * x + c, 0));
    }
    for (const joint of content.joints) {
      motion(joint, q.get(joint.name), links.get(joint.link).group.matrix);
    }
    scene.updateMatrixWorld(true);
  }

  function move(values) {
    place(values);
    showValues();
    if (renderer) renderer.shadowMap.needsUpdate = true;
    draw();
  }

  // Pose of a link in the object frame, 16 numbers by rows.
  function pose(name) {
    const link = links.get(name);
    return link.group.matrixWorld.clone().multiply(link.T_ol).transpose().toArray();
  }

  const clamped = (joint, value) => Math.min(joint.high, Math.max(joint.low, value));

  // Sliders.
  const sliders = new Map(), outputs = new Map();
  for (const input of root.querySelectorAll("input[data-joint]")) {
    sliders.set(input.dataset.joint, input);
    input.addEventListener("input", () => {
      stop();
      move({ [input.dataset.joint]: Number(input.value) });
    });
    const link = joints.get(input.dataset.joint).link;
    input.addEventListener("focus", () => mark(link));
    input.addEventListener("blur", () => mark(null));
  }
  for (const output of root.querySelectorAll("output")) outputs.set(output.dataset.joint, output);

  function showValues() {
    for (const [name, joint] of joints) {
      const value = q.get(name), input = sliders.get(name);
      if (Number(input.value) !== value) input.value = value;
      const share = (value - joint.low) / (joint.high - joint.low || 1);
      input.style.setProperty("--share", `${100 * (joint.open < joint.closed ? 1 - share : share)}%`);
      const shown = joint.kind === "slide" ? `${(1000 * value).toFixed(0)} mm` : `${(value / radians).toFixed(0)}°`;
      outputs.get(name).textContent = shown.replace("-", "−").replace("−0 ", "0 ").replace("−0°", "0°");
    }
  }

  // Surfaces.
  const layers = { visual: [], collision: [] };
  const low = new THREE.Vector3(...content.bounds[0]), high = new THREE.Vector3(...content.bounds[1]);
  const middle = low.clone().add(high).multiplyScalar(0.5), radius = 0.5 * high.distanceTo(low) || 1;

  function bytes(text) {
    return Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  }

  function decoded(surface) {
    const grid = new Uint16Array(bytes(surface.vertices));
    const faces = surface.wide ? new Uint32Array(bytes(surface.faces)) : new Uint16Array(bytes(surface.faces));
    const at = Float32Array.from(grid, (n, i) => surface.low[i % 3] + n * surface.step[i % 3]);
    return { at, faces };
  }

  // Corners of triangles with normals that are smooth across flat edges and sharp across others.
  function geometry({ at, faces }) {
    const n = faces.length / 3, normal = new Float32Array(3 * n), count = new Uint32Array(at.length / 3 + 1);
    const a = new THREE.Vector3(), b = new THREE.Vector3(), c = new THREE.Vector3();
    for (let f = 0; f < n; f++) {
      a.fromArray(at, 3 * faces[3 * f]);
      b.fromArray(at, 3 * faces[3 * f + 1]).sub(a);
      c.fromArray(at, 3 * faces[3 * f + 2]).sub(a);
      b.cross(c).toArray(normal, 3 * f); // as long as twice the area: large faces weigh more
      for (let k = 0; k < 3; k++) count[faces[3 * f + k] + 1]++;
    }
    for (let i = 1; i < count.length; i++) count[i] += count[i - 1];
    const around = new Uint32Array(3 * n), next = count.slice();
    for (let i = 0; i < 3 * n; i++) around[next[faces[i]]++] = Math.floor(i / 3);
    const position = new Float32Array(9 * n), smooth = new Float32Array(9 * n);
    const crease = Math.cos(35 * radians);
    for (let i = 0; i < 3 * n; i++) {
      const vertex = faces[i];
      a.fromArray(normal, 3 * Math.floor(i / 3));
      const size = a.length() || 1;
      c.set(0, 0, 0);
      for (let j = count[vertex]; j < count[vertex + 1]; j++) {
        b.fromArray(normal, 3 * around[j]);
        if (a.dot(b) >= crease * size * b.length()) c.add(b);
      }
      c.normalize().toArray(smooth, 3 * i);
      position.set(at.subarray(3 * vertex, 3 * vertex + 3), 3 * i);
    }
    const out = new THREE.BufferGeometry();
    out.setAttribute("position", new THREE.BufferAttribute(position, 3));
    out.setAttribute("normal", new THREE.BufferAttribute(smooth, 3));
    return out;
  }

  function addSurface(surface) {
    const colour = new THREE.Color(...surface.rgba.slice(0, 3)).convertSRGBToLinear();
    const clear = surface.rgba[3] < 0.999;
    const material = new THREE.MeshStandardMaterial({
      color: colour, roughness: 0.75, side: THREE.DoubleSide,
      transparent: clear, opacity: surface.rgba[3], depthWrite: !clear,
      polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
    });
    const mesh = new THREE.Mesh(geometry(decoded(surface)), material);
    mesh.userData = { link: surface.link, opacity: surface.rgba[3] };
    mesh.castShadow = surface.layer === "visual" && !clear;
    mesh.receiveShadow = mesh.castShadow;
    links.get(surface.link).group.add(mesh);
    layers[surface.layer].push(mesh);
    const dark = surface.layer === "visual" ? 0.3 : 0.5;
    const ink = new THREE.LineBasicMaterial({ color: 0x10151a, transparent: true, opacity: dark });
    const edges = new THREE.LineSegments(new THREE.EdgesGeometry(mesh.geometry, 32), ink);
    edges.raycast = () => {};
    mesh.add(edges);
    mesh.userData.edges = edges;
  }

  // Visual and collision shapes, one or both; where there is only one of them it stays.
  let seeThrough = false;
  function showLayers() {
    const both = layers.visual.length > 0;
    for (const mesh of layers.visual) {
      const opacity = seeThrough ? 0.1 : mesh.userData.opacity;
      const clear = opacity < 0.999;
      Object.assign(mesh.material, { opacity, transparent: clear, depthWrite: !clear, needsUpdate: true });
      mesh.userData.edges.visible = !seeThrough;
    }
    for (const mesh of layers.collision) mesh.visible = seeThrough || !both;
    draw();
  }

  function mark(link) {
    for (const mesh of [...layers.visual, ...layers.collision]) {
      mesh.material.emissive.setHex(link !== null && mesh.userData.link === link ? 0x14324f : 0);
    }
    for (const [name, input] of sliders) {
      input.parentElement.classList.toggle("held", link !== null && joints.get(name).link === link);
    }
    draw();
  }

  // Camera: it looks at a target from a direction and a distance.
  const camera = new THREE.PerspectiveCamera(32, 1, 0.01, 100);
  camera.up.set(0, 0, 1);
  const eye = { azimuth: 0, elevation: 0, distance: 1, target: new THREE.Vector3() };
  let renderer = null, waiting = false;

  function resetView() {
    const narrow = Math.min(1, camera.aspect);
    eye.azimuth = content.azimuth_deg * radians;
    eye.elevation = content.elevation_deg * radians;
    eye.distance = (1.22 * radius) / Math.sin(0.5 * camera.fov * radians) / Math.sqrt(narrow);
    eye.target.copy(middle);
    eye.own = false;
    draw();
  }

  function placeCamera() {
    const flat = Math.cos(eye.elevation);
    const across = [flat * Math.cos(eye.azimuth), flat * Math.sin(eye.azimuth)];
    const ahead = new THREE.Vector3(...across, Math.sin(eye.elevation));
    camera.position.copy(eye.target).addScaledVector(ahead, -eye.distance);
    camera.near = eye.distance / 100;
    camera.far = eye.distance * 10 + 10 * radius;
    camera.lookAt(eye.target);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld(true);
  }

  function draw() {
    if (!renderer || waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      placeCamera();
      renderer.render(scene, camera);
    });
  }

  function turn(dx, dy) {
    eye.own = true;
    eye.azimuth -= 0.008 * dx;
    eye.elevation = Math.min(1.5, Math.max(-1.5, eye.elevation - 0.008 * dy));
    draw();
  }

  function zoom(factor) {
    eye.own = true;
    eye.distance = Math.min(20 * radius, Math.max(0.3 * radius, eye.distance * factor));
    draw();
  }

  function pan(dx, dy) {
    eye.own = true;
    const size = (2 * eye.distance * Math.tan(0.5 * camera.fov * radians)) / canvas.clientHeight;
    eye.target.addScaledVector(new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, 0), -dx * size);
    eye.target.addScaledVector(new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, 1), dy * size);
    draw();
  }

  // Picking: what lies under the pointer, and the joint that moves it.
  const ray = new THREE.Raycaster();
  function pick(event) {
    const box = canvas.getBoundingClientRect();
    const x = (2 * (event.clientX - box.left)) / box.width - 1;
    const y = 1 - (2 * (event.clientY - box.top)) / box.height;
    placeCamera();
    ray.setFromCamera({ x, y }, camera);
    const shown = seeThrough || !layers.visual.length ? layers.collision : layers.visual;
    const hit = ray.intersectObjects(shown, false)[0];
    if (!hit) return null;
    let link = hit.object.userData.link;
    while (link !== null && !jointOf.has(link)) link = links.get(link).parent;
    if (link === null) return null;
    let name = jointOf.get(link);
    while (leaderOf.has(name)) name = leaderOf.get(name);
    if (!joints.has(name)) return null;
    const group = links.get(hit.object.userData.link).group;
    return { name, link, group, point: hit.point.clone().applyMatrix4(group.matrixWorld.clone().invert()) };
  }

  // Where the held point is on the screen [px] with its joint at a position.
  function onScreen(held, value) {
    const before = q.get(held.name);
    place({ [held.name]: value });
    const p = held.point.clone().applyMatrix4(held.group.matrixWorld).project(camera);
    place({ [held.name]: before });
    return [0.5 * p.x * canvas.clientWidth, -0.5 * p.y * canvas.clientHeight];
  }

  function pull(held, dx, dy) {
    const joint = joints.get(held.name), value = q.get(held.name);
    const step = 1e-3 * (joint.kind === "slide" ? radius : 1);
    const here = onScreen(held, value), there = onScreen(held, value + step);
    let along = [(there[0] - here[0]) / step, (there[1] - here[1]) / step];
    // A part that moves straight at the eye follows the pointer downwards.
    const least = (0.25 * canvas.clientHeight) / (joint.kind === "slide" ? 2 * radius : 2);
    const length = Math.hypot(...along);
    if (length < least) along = length ? along.map((v) => (v * least) / length) : [0, least];
    const change = (dx * along[0] + dy * along[1]) / (along[0] ** 2 + along[1] ** 2);
    move({ [held.name]: clamped(joint, value + change) });
  }

  // Pointers: one drags a part or turns the object, two zoom and shift it.
  const pointers = new Map();
  let held = null;
  function listen() {
    canvas.addEventListener("pointerdown", (event) => {
      stop();
      canvas.focus({ preventScroll: true });
      canvas.setPointerCapture?.(event.pointerId);
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      held = pointers.size === 1 && event.button === 0 && !event.shiftKey ? pick(event) : null;
      mark(held && held.link);
    });
    canvas.addEventListener("pointermove", (event) => {
      const last = pointers.get(event.pointerId);
      if (!last) {
        canvas.style.cursor = event.pointerType === "mouse" && pick(event) ? "grab" : "";
        return;
      }
      const now = [event.clientX, event.clientY], dx = now[0] - last[0], dy = now[1] - last[1];
      if (pointers.size === 2) {
        const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
        const distance = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
        zoom(distance(last) / distance(now));
        pan(dx / 2, dy / 2);
      } else if (held) pull(held, dx, dy);
      else if (event.shiftKey || event.buttons & 6) pan(dx, dy);
      else turn(dx, dy);
      pointers.set(event.pointerId, now);
    });
    for (const kind of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(kind, (event) => {
        pointers.delete(event.pointerId);
        held = null;
        mark(null);
      });
    }
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    // A page that is scrolled past must not be caught: the wheel zooms after a click only.
    canvas.addEventListener("wheel", (event) => {
      if (document.activeElement !== canvas && !event.ctrlKey) return;
      event.preventDefault();
      zoom(Math.exp((event.deltaMode ? 30 : 1) * event.deltaY * (event.ctrlKey ? 0.01 : 0.0015)));
    }, { passive: false });
    canvas.addEventListener("pointerleave", () => pointers.size || canvas.blur());
    canvas.addEventListener("keydown", (event) => {
      const turns = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, -12], ArrowDown: [0, 12] };
      if (turns[event.key]) turn(...turns[event.key]);
      else if (event.key === "+" || event.key === "=") zoom(0.9);
      else if (event.key === "-") zoom(1.1);
      else return;
      event.preventDefault();
    });
  }

  // Films: joints that go to where they shall in some time.
  let playing = 0;
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  const free = content.joints.filter((joint) => !leaderOf.has(joint.name));
  const button = (name) => root.querySelector(`[data-do="${name}"]`);
  const press = (name, on) => button(name)?.setAttribute("aria-pressed", String(on));
  function stop() {
    playing++;
    press("play", false);
  }

  function glide(goal, seconds, mine) {
    const from = Object.fromEntries(Object.keys(goal).map((name) => [name, q.get(name)]));
    return new Promise((done) => {
      const begin = performance.now();
      const frame = (now) => {
        if (playing !== mine) return done(false);
        const t = calm.matches ? 1 : Math.min(1, Math.max(0, (now - begin) / (1000 * seconds)));
        const s = t * t * (3 - 2 * t);
        move(Object.fromEntries(Object.keys(goal).map((n) => [n, from[n] + s * (goal[n] - from[n])])));
        return t < 1 ? requestAnimationFrame(frame) : done(true);
      };
      requestAnimationFrame(frame);
    });
  }

  async function play() {
    stop();
    const mine = playing;
    press("play", true);
    await glide(Object.fromEntries(free.map((joint) => [joint.name, joint.closed])), 0.3, mine);
    for (const joint of free) {
      for (const end of ["open", "closed"]) {
        if (!(await glide({ [joint.name]: joint[end] }, 0.9, mine))) return;
      }
    }
    stop();
  }

  const actions = {
    view: resetView,
    play: () => (button("play").getAttribute("aria-pressed") === "true" ? stop() : play()),
    all() {
      stop();
      const open = button("all").getAttribute("aria-pressed") !== "true";
      press("all", open);
      button("all").textContent = open ? "Close all" : "Open all";
      glide(Object.fromEntries(free.map((j) => [j.name, open ? j.open : j.closed])), 0.7, playing);
    },
    collision() {
      seeThrough = !seeThrough;
      press("collision", seeThrough);
      showLayers();
    },
  };
  for (const [name, action] of Object.entries(actions)) button(name)?.addEventListener("click", action);

  function light() {
    scene.add(new THREE.HemisphereLight(0xf4f7fb, 0x8d8a84, 0.64));
    const sun = new THREE.DirectionalLight(0xfffaf2, 0.5);
    // Over the left shoulder of who sees the object first.
    const from = content.azimuth_deg * radians - 0.8;
    sun.position.set(-Math.cos(from), -Math.sin(from), 1.5).multiplyScalar(3 * radius).add(middle);
    sun.target.position.copy(middle);
    sun.castShadow = true;
    sun.shadow.mapSize.set(2048, 2048);
    sun.shadow.normalBias = 0.004 * radius;
    const reach = 2.2 * radius, view = sun.shadow.camera;
    Object.assign(view, { left: -reach, right: reach, top: reach, bottom: -reach });
    Object.assign(view, { near: 0.1 * radius, far: 12 * radius });
    scene.add(sun, sun.target);
    const floor = new THREE.Mesh(new THREE.CircleGeometry(6 * radius, 48), new THREE.ShadowMaterial({ opacity: 0.22 }));
    floor.position.set(middle.x, middle.y, low.z - 0.002 * radius);
    floor.receiveShadow = true;
    scene.add(floor);
  }

  function start() {
    renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    renderer.outputEncoding = THREE.sRGBEncoding;
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    renderer.shadowMap.autoUpdate = false; // they change when parts move, not when one looks round
    renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    light();
    content.surfaces.forEach(addSurface);
    showLayers();
    move({});
    const fit = () => {
      const { clientWidth: width, clientHeight: height } = canvas.parentElement;
      if (!width || !height) return;
      renderer.setSize(width, height, false);
      camera.aspect = width / height;
      if (eye.own === true) draw();
      else resetView();
    };
    new ResizeObserver(fit).observe(canvas.parentElement);
    canvas.addEventListener("webglcontextrestored", draw);
    fit();
    listen();
  }

  window.articulate = {
    pose, joints: [...joints.keys()], links: [...links.keys()],
    get: (name) => q.get(name),
    set: (name, value) => move({ [name]: value }),
    drawn: () => renderer !== null && renderer.info.render.triangles,
  };
  move({});
  try {
    start();
  } catch (error) {
    renderer = null;
    root.classList.add("flat");
    const trouble = root.querySelector(".trouble");
    trouble.hidden = false;
    trouble.textContent = `This browser draws no 3-D here (${error.message}); the images show the object.`;
  }
})();
