/* 3-D view of the object: parts that move, the axis and the range of the selected part, picking.
   All data is in the object frame with every joint at 0; a part moves with its parent. */
"use strict";
window.makeView = (canvas, on) => {
  const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(32, 1, 0.01, 100);
  camera.up.set(0, 0, 1);
  const cache = new Map(); // three.js geometry and components by key of a piece
  const parts = new Map(), q = new Map();
  const eye = { azimuth: 0, elevation: 0, distance: 1, target: new THREE.Vector3() };
  const overlay = new THREE.Group();
  let renderer = null, waiting = false, radius = 1, chosen = null, mode = "move", state = null, painted = new Map();
  scene.add(overlay, new THREE.HemisphereLight(0xf4f7fb, 0x8d8a84, 0.7));
  const sun = new THREE.DirectionalLight(0xfffaf2, 0.55);
  scene.add(sun, sun.target);

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  function addGeometry(content) {
    for (const [key, piece] of Object.entries(content)) {
      if (cache.has(key)) continue;
      const vertices = new Float32Array(bytes(piece.vertices)), faces = new Uint32Array(bytes(piece.faces));
      const position = new Float32Array(3 * faces.length);
      for (let i = 0; i < faces.length; i++) position.set(vertices.subarray(3 * faces[i], 3 * faces[i] + 3), 3 * i);
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
      geometry.computeVertexNormals(); // corners are not shared: flat faces
      cache.set(key, { geometry, rgba: piece.rgba, components: new Uint32Array(bytes(piece.components)),
        edges: new THREE.EdgesGeometry(geometry, 32) });
    }
  }
  const missing = (next) => next.parts.some((part) => part.pieces.some((key) => !cache.has(key)));

  function motion(joint, value, out = new THREE.Matrix4()) {
    const axis = new THREE.Vector3(...joint.axis);
    if (joint.kind === "fixed") return out.identity();
    if (joint.kind === "prismatic") return out.makeTranslation(...axis.multiplyScalar(value).toArray());
    const pivot = new THREE.Vector3(...joint.pivot);
    out.makeRotationAxis(axis, value);
    return out.setPosition(pivot.clone().sub(pivot.clone().applyMatrix4(out)));
  }
  function range(joint) {
    if (joint.lower !== null && joint.upper !== null) return [joint.lower, joint.upper];
    return joint.kind === "prismatic" ? [0, 0.5 * radius] : [0, 2 * Math.PI];
  }
  const clamp = (v, [low, high]) => Math.min(high, Math.max(low, v));

  function setState(next) {
    const first = state === null;
    state = next;
    for (const part of parts.values()) part.group.removeFromParent();
    parts.clear();
    painted = new Map();
    const low = new THREE.Vector3(...next.bounds[0]), high = new THREE.Vector3(...next.bounds[1]);
    radius = 0.5 * high.distanceTo(low) || 1;
    for (const part of next.parts) {
      const group = new THREE.Group();
      group.matrixAutoUpdate = false;
      (part.joint ? parts.get(part.joint.parent).group : scene).add(group);
      const meshes = part.pieces.map((key, index) => {
        const piece = cache.get(key), clear = piece.rgba[3] < 0.999;
        const mesh = new THREE.Mesh(piece.geometry, new THREE.MeshStandardMaterial({
          color: new THREE.Color(...piece.rgba.slice(0, 3)).convertSRGBToLinear(), roughness: 0.75, side: THREE.DoubleSide,
          transparent: clear, opacity: piece.rgba[3], polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 }));
        mesh.userData = { part: part.name, index, key };
        const ink = new THREE.LineSegments(piece.edges, new THREE.LineBasicMaterial({ color: 0x10151a, transparent: true, opacity: 0.3 }));
        ink.raycast = () => {};
        mesh.add(ink);
        group.add(mesh);
        return mesh;
      });
      parts.set(part.name, { ...part, group, meshes });
      const kept = q.get(part.name) ?? 0;
      q.set(part.name, part.joint && part.joint.kind !== "fixed" ? clamp(kept, range(part.joint)) : 0);
    }
    if (first) resetView();
    select(parts.has(chosen) ? chosen : null);
    place();
  }

  function place() {
    const byJoint = new Map([...parts.values()].filter((p) => p.joint).map((p) => [p.joint.name, p.name]));
    for (const [name, part] of parts) {
      if (!part.joint) continue;
      if (part.joint.mimic && byJoint.has(part.joint.mimic[0])) {
        const [leader, multiplier, offset] = part.joint.mimic;
        q.set(name, multiplier * q.get(byJoint.get(leader)) + offset);
      }
      motion(part.joint, q.get(name), part.group.matrix);
    }
    scene.updateMatrixWorld(true);
    showOverlay();
    draw();
  }

  function setPosition(name, value) {
    const joint = parts.get(name).joint;
    if (!joint || joint.kind === "fixed") return;
    q.set(name, clamp(value, range(joint)));
    place();
    on.move(name, q.get(name));
  }

  // Axis, path and handles of the limits of the selected part.
  let handles = [];
  function reference(part) {
    const low = new THREE.Vector3(...part.bounds[0]), high = new THREE.Vector3(...part.bounds[1]);
    const centre = low.clone().add(high).multiplyScalar(0.5);
    const axis = new THREE.Vector3(...part.joint.axis);
    if (part.joint.kind === "prismatic") {
      const half = high.sub(low).multiplyScalar(0.5);
      return centre.addScaledVector(axis, Math.abs(axis.x) * half.x + Math.abs(axis.y) * half.y + Math.abs(axis.z) * half.z);
    }
    const pivot = new THREE.Vector3(...part.joint.pivot), arm = centre.clone().sub(pivot);
    arm.addScaledVector(axis, -arm.dot(axis));
    if (arm.length() < 0.05 * radius) return centre.addScaledVector(new THREE.Vector3(axis.y, axis.z, axis.x).cross(axis).normalize(), 0.3 * radius);
    return centre.add(arm);
  }
  function showOverlay() {
    overlay.clear();
    handles = [];
    const part = parts.get(chosen);
    if (!part || !part.joint || part.joint.kind === "fixed") return;
    const above = parts.get(part.joint.parent).group.matrixWorld, joint = part.joint;
    const at = reference(part), point = (value) => at.clone().applyMatrix4(motion(joint, value)).applyMatrix4(above);
    const axis = new THREE.Vector3(...joint.axis);
    const from = joint.kind === "prismatic" ? at.clone() : new THREE.Vector3(...joint.pivot);
    if (joint.kind !== "prismatic") { // the point of the axis beside the part
      const middle = new THREE.Vector3(...part.bounds[0]).add(new THREE.Vector3(...part.bounds[1])).multiplyScalar(0.5);
      from.addScaledVector(axis, middle.sub(from).dot(axis));
      const line = [-1, 1].map((s) => from.clone().addScaledVector(axis, s * 0.75 * radius).applyMatrix4(above));
      overlay.add(thin(line, 0xc2185b));
    }
    const cone = new THREE.Mesh(new THREE.ConeGeometry(0.022 * radius, 0.08 * radius, 16), flat(0xc2185b));
    const ahead = axis.clone().transformDirection(above);
    cone.position.copy(from).addScaledVector(axis, (joint.kind === "prismatic" ? 0.3 : 0.75) * radius).applyMatrix4(above);
    cone.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), ahead);
    overlay.add(cone);
    const [low, high] = range(joint), path = [];
    for (let k = 0; k <= 48; k++) path.push(point(low + ((high - low) * k) / 48));
    overlay.add(thin(path, 0x1f6fb2));
    if (joint.lower === null) return;
    for (const [end, value, colour] of [["lower", low, 0x1d7a46], ["upper", high, 0xe08a00]]) {
      const ball = new THREE.Mesh(new THREE.SphereGeometry(0.03 * radius, 20, 14), flat(colour));
      ball.position.copy(point(value));
      ball.userData = { end, point };
      overlay.add(ball);
      handles.push(ball);
    }
  }
  const flat = (color) => new THREE.MeshBasicMaterial({ color, depthTest: false, transparent: true });
  function thin(points, color) {
    const line = new THREE.Line(new THREE.BufferGeometry().setFromPoints(points), new THREE.LineBasicMaterial({ color, depthTest: false, transparent: true }));
    line.renderOrder = 2;
    return line;
  }

  function select(name) {
    chosen = name;
    for (const [own, part] of parts) for (const mesh of part.meshes) mesh.material.emissive.setHex(own === name ? 0x14324f : 0);
    showOverlay();
    draw();
  }

  // Camera.
  function resetView() {
    eye.azimuth = (state.azimuth_deg * Math.PI) / 180;
    eye.elevation = (state.elevation_deg * Math.PI) / 180;
    eye.distance = (1.35 * radius) / Math.sin((0.5 * camera.fov * Math.PI) / 180) / Math.sqrt(Math.min(1, camera.aspect));
    eye.target.set(...state.bounds[0]).add(new THREE.Vector3(...state.bounds[1])).multiplyScalar(0.5);
    sun.position.set(-Math.cos(eye.azimuth - 1.1), -Math.sin(eye.azimuth - 1.1), 1.5).multiplyScalar(3 * radius).add(eye.target);
    sun.target.position.copy(eye.target);
    draw();
  }
  function placeCamera() {
    const flatness = Math.cos(eye.elevation);
    const ahead = new THREE.Vector3(flatness * Math.cos(eye.azimuth), flatness * Math.sin(eye.azimuth), Math.sin(eye.elevation));
    camera.position.copy(eye.target).addScaledVector(ahead, -eye.distance);
    camera.near = eye.distance / 100;
    camera.far = 10 * (eye.distance + radius);
    camera.lookAt(eye.target);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld(true);
  }
  function draw() {
    if (!renderer || waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; placeCamera(); renderer.render(scene, camera); });
  }
  const zoom = (factor) => { eye.distance = clamp(eye.distance * factor, [0.3 * radius, 20 * radius]); draw(); };
  function pan(dx, dy) {
    const size = (2 * eye.distance * Math.tan((0.5 * camera.fov * Math.PI) / 180)) / canvas.clientHeight;
    eye.target.addScaledVector(new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, 0), -dx * size);
    eye.target.addScaledVector(new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, 1), dy * size);
    draw();
  }
  function turn(dx, dy) {
    eye.azimuth -= 0.008 * dx;
    eye.elevation = clamp(eye.elevation - 0.008 * dy, [-1.5, 1.5]);
    draw();
  }

  // Picking.
  const ray = new THREE.Raycaster();
  function aim(event) {
    const box = canvas.getBoundingClientRect();
    placeCamera();
    ray.setFromCamera({ x: (2 * (event.clientX - box.left)) / box.width - 1, y: 1 - (2 * (event.clientY - box.top)) / box.height }, camera);
  }
  function pick(event) {
    aim(event);
    const hit = ray.intersectObjects([...parts.values()].flatMap((part) => part.meshes), false)[0];
    if (!hit) return null;
    const { part, index, key } = hit.object.userData, group = parts.get(part).group;
    const local = hit.point.clone().applyMatrix4(group.matrixWorld.clone().invert());
    return { part, index, key, face: hit.faceIndex, point: local.toArray(), normal: hit.face.normal.toArray() };
  }
  function handleAt(event) {
    const box = canvas.getBoundingClientRect();
    placeCamera();
    const near = handles.map((ball) => [Math.hypot(...minus(onScreen(ball.position), [event.clientX - box.left, event.clientY - box.top])), ball]);
    near.sort((a, b) => a[0] - b[0]);
    return near.length && near[0][0] < 14 ? near[0][1] : null;
  }
  const minus = (a, b) => [a[0] - b[0], a[1] - b[1]];
  function onScreen(point) {
    const p = point.clone().project(camera);
    return [0.5 * (p.x + 1) * canvas.clientWidth, 0.5 * (1 - p.y) * canvas.clientHeight];
  }
  function mover(name) { // the part that moves when this one is pulled
    let part = parts.get(name);
    while (part && part.joint && (part.joint.kind === "fixed" || part.joint.mimic)) part = parts.get(part.joint.parent);
    return part && part.joint ? part.name : null;
  }
  function pull(held, dx, dy) {
    const joint = parts.get(held.name).joint, value = q.get(held.name), group = parts.get(held.part).group;
    const at = (v) => {
      q.set(held.name, v);
      place();
      return onScreen(new THREE.Vector3(...held.point).applyMatrix4(group.matrixWorld));
    };
    placeCamera();
    const step = 1e-3 * (joint.kind === "prismatic" ? radius : 1), here = at(value), there = at(value + step);
    let along = minus(there, here).map((v) => v / step);
    const least = (0.25 * canvas.clientHeight) / (joint.kind === "prismatic" ? 2 * radius : 2), length = Math.hypot(...along);
    if (length < least) along = length ? along.map((v) => (v * least) / length) : [0, least];
    setPosition(held.name, value + (dx * along[0] + dy * along[1]) / (along[0] ** 2 + along[1] ** 2));
  }
  function pullHandle(ball, event) {
    const box = canvas.getBoundingClientRect(), target = [event.clientX - box.left, event.clientY - box.top];
    const joint = parts.get(chosen).joint, slide = joint.kind === "prismatic";
    const span = slide ? 2 * radius : Math.PI, now = joint[ball.userData.end];
    let best = now, least = Infinity;
    for (let k = 0; k <= 720; k++) {
      // Near the present value: seen from the side, distant points of the path are in one place.
      const value = Math.min(span, Math.max(-span, now + span * (k / 360 - 1) * 0.25));
      const away = Math.hypot(...minus(onScreen(ball.userData.point(value)), target)) + 1e-3 * Math.abs(value - now);
      if (away < least) [best, least] = [value, away];
    }
    const gap = slide ? 0.005 * radius : 0.02;
    joint[ball.userData.end] = ball.userData.end === "lower" ? Math.min(best, joint.upper - gap) : Math.max(best, joint.lower + gap);
    q.set(chosen, joint[ball.userData.end]);
    place();
    on.move(chosen, q.get(chosen));
  }

  // Selection of faces for a new part.
  function paint(hit, grain, add = true) {
    const set = painted.get(hit.index) ?? new Set(), components = cache.get(hit.key).components;
    components.forEach((c, face) => {
      if (grain === "face" ? face !== hit.face : grain === "piece" && c !== components[hit.face]) return;
      if (add) set.add(face);
      else set.delete(face);
    });
    painted.set(hit.index, set);
    showPaint();
  }
  function showPaint() {
    for (const mesh of parts.get(chosen)?.meshes ?? []) {
      mesh.getObjectByName("paint")?.removeFromParent();
      const set = painted.get(mesh.userData.index);
      if (!set || !set.size) continue;
      const all = mesh.geometry.getAttribute("position").array, out = new Float32Array(9 * set.size);
      [...set].forEach((face, k) => out.set(all.subarray(9 * face, 9 * face + 9), 9 * k));
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(out, 3));
      const cover = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color: 0xe08a00, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: -2, polygonOffsetUnits: -2 }));
      cover.name = "paint";
      cover.raycast = () => {};
      mesh.add(cover);
    }
    draw();
  }
  const selection = () => (parts.get(chosen)?.meshes ?? []).map((mesh) => [...(painted.get(mesh.userData.index) ?? [])].sort((a, b) => a - b));
  function clearPaint() { painted = new Map(); showPaint(); }

  // Pointers.
  const pointers = new Map();
  let held = null, handle = null, moved = 0, painting = null;
  canvas.addEventListener("pointerdown", (event) => {
    try { canvas.setPointerCapture(event.pointerId); } catch { /* the pointer has gone */ }
    canvas.focus({ preventScroll: true });
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    moved = 0;
    held = handle = painting = null;
    if (pointers.size > 1 || event.button !== 0 || event.shiftKey) return;
    if (mode === "move") handle = on.editable() ? handleAt(event) : null;
    const hit = handle ? null : pick(event);
    if (mode === "paint" && hit && hit.part === chosen) {
      const had = painted.get(hit.index)?.has(hit.face) ?? false;
      painting = { add: !had, grain: on.grain() };
      paint(hit, painting.grain, painting.add);
    } else if (mode === "move" && hit) {
      held = { ...hit, name: mover(hit.part) };
    }
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) {
      canvas.style.cursor = mode !== "move" ? "crosshair" : event.pointerType === "mouse" && (handleAt(event) || pick(event)) ? "grab" : "";
      return;
    }
    const now = [event.clientX, event.clientY], [dx, dy] = minus(now, last);
    moved += Math.hypot(dx, dy);
    pointers.set(event.pointerId, now);
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
      zoom((Math.hypot(...minus(last, other)) || 1) / (Math.hypot(...minus(now, other)) || 1));
      pan(dx / 2, dy / 2);
    } else if (handle) pullHandle(handle, event);
    else if (painting) {
      const hit = pick(event);
      if (hit && hit.part === chosen) paint(hit, painting.grain, painting.add);
    } else if (held && held.name) { if (moved > 3) pull(held, dx, dy); }
    else if (event.shiftKey || event.buttons & 6) pan(dx, dy);
    else turn(dx, dy);
  });
  canvas.addEventListener("pointerup", (event) => {
    pointers.delete(event.pointerId);
    if (handle) on.limits(chosen, parts.get(chosen).joint);
    else if (moved < 5 && !painting && event.button === 0) {
      const hit = pick(event);
      if (hit) on.click(hit, mode);
    }
    held = handle = painting = null;
  });
  canvas.addEventListener("pointercancel", (event) => { pointers.delete(event.pointerId); held = handle = painting = null; });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp((event.deltaMode ? 30 : 1) * event.deltaY * 0.0015));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const turns = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, -12], ArrowDown: [0, 12] };
    if (turns[event.key]) turn(...turns[event.key]);
    else if (event.key === "+" || event.key === "=") zoom(0.9);
    else if (event.key === "-") zoom(1.1);
    else return;
    event.preventDefault();
  });

  renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
  renderer.outputEncoding = THREE.sRGBEncoding;
  renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
  new ResizeObserver(() => {
    const { clientWidth: width, clientHeight: height } = canvas.parentElement;
    if (!width || !height) return;
    const first = camera.aspect === 1;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    if (state && first) resetView();
    draw();
  }).observe(canvas.parentElement);

  return {
    addGeometry, missing, setState, select, setPosition, range, resetView, selection, clearPaint, paint,
    position: (name) => q.get(name),
    setMode(next) { mode = next; canvas.style.cursor = next === "move" ? "" : "crosshair"; },
    setEye(azimuth_deg, elevation_deg) { eye.azimuth = (azimuth_deg * Math.PI) / 180; eye.elevation = (elevation_deg * Math.PI) / 180; draw(); },
    // Position in the window [px] of a point of a part, and of the handle of a limit.
    screen(name, point) {
      placeCamera();
      const box = canvas.getBoundingClientRect(), p = onScreen(new THREE.Vector3(...point).applyMatrix4(parts.get(name).group.matrixWorld));
      return [box.left + p[0], box.top + p[1]];
    },
    handle(end, value) {
      placeCamera();
      const box = canvas.getBoundingClientRect(), ball = handles.find((h) => h.userData.end === end);
      const p = onScreen(value === undefined ? ball.position : ball.userData.point(value));
      return [box.left + p[0], box.top + p[1]];
    },
    pick: (x, y) => pick({ clientX: x, clientY: y }),
    triangles: () => renderer.info.render.triangles,
  };
};
