/* Parts, editor, evidence and history around the 3-D view. The server holds the object: each correction is
   sent as an edit, and the answer is the new state. */
"use strict";
(() => {
  const $ = (id) => document.getElementById(id), degrees = 180 / Math.PI;
  let state = null, chosen = null, mode = "move", grain = "mesh", view = null, sending = 0;

  function make(tag, attributes = {}, ...children) {
    const node = document.createElement(tag);
    for (const [key, value] of Object.entries(attributes)) {
      if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
      else if (typeof value === "boolean") node[key] = value;
      else node.setAttribute(key, value);
    }
    node.append(...children.filter((child) => child !== null));
    return node;
  }
  const button = (label, onclick, more = {}) => make("button", { type: "button", onclick, ...more }, label);

  function message(text, good = false) {
    $("message").textContent = text;
    $("message").hidden = !text;
    $("message").classList.toggle("good", good);
  }

  async function request(path, body) {
    const options = body === undefined ? {} : { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
    let response, content;
    try {
      response = await fetch(path, options);
      content = await response.json();
    } catch {
      throw new Error("the server does not answer; is articulate studio still running?");
    }
    if (!response.ok) throw new Error(content.error);
    return content;
  }
  async function send(path, body = {}) {
    sending++;
    try {
      const next = await request(path, body);
      message("");
      await show(next);
      return true;
    } catch (error) {
      message(error.message);
      if (state) view.setState(state = await request("state").catch(() => state));
      return false;
    } finally {
      sending--;
    }
  }
  const edit = (type, fields) => { leave(); return send("edit", { ...fields, type }); };

  async function show(next) {
    if (view.missing(next)) view.addGeometry(await request("geometry"));
    state = next;
    view.setState(next);
    if (!next.parts.some((part) => part.name === chosen)) chosen = null;
    if (chosen === null) chosen = (next.parts.find((p) => p.joint && p.doubtful) ?? next.parts.find((p) => p.joint))?.name ?? null;
    view.select(chosen);
    showHead();
    showList();
    showEditor();
    showEvidence();
  }

  const GOOD = ["passed", "repaired"];
  function badge(node, text, tone) {
    node.textContent = text;
    node.className = `badge ${tone}`;
    node.hidden = !text;
  }
  function showHead() {
    $("name").textContent = state.name;
    badge($("verdict"), state.verdict ? `made: ${state.verdict}` : "", GOOD.includes(state.verdict) ? "good" : state.verdict === "rejected" ? "bad" : "doubt");
    $("undo").disabled = !state.can_undo;
    $("redo").disabled = !state.can_redo;
    showCheck();
  }
  function showCheck() {
    const check = state.check;
    if (!check) return badge($("check"), "", "");
    if (check.state === "running") badge($("check"), "checking …", "");
    else badge($("check"), `checks: ${check.verdict}`, GOOD.includes(check.verdict) ? "good" : "bad");
    const failures = check.state === "done" && !GOOD.includes(check.verdict) ? check.reasons : [];
    $("findings").hidden = !failures.length;
    $("findings").open = failures.length > 0;
    $("failures").replaceChildren(...failures.map((text) => make("li", {}, text)));
  }

  const isSlide = (joint) => joint.kind === "prismatic";
  const shown = (joint, value) => (isSlide(joint) ? 1000 * value : degrees * value);
  const stored = (joint, value) => (isSlide(joint) ? value / 1000 : value / degrees);
  const unit = (joint) => (isSlide(joint) ? "mm" : "°");
  const format = (joint, value) => `${shown(joint, value).toFixed(0)} ${unit(joint)}`.replace(" °", "°");

  function showList() {
    $("list").replaceChildren(...state.parts.map((part) => {
      const joint = part.joint, moves = joint && joint.kind !== "fixed";
      const marks = [];
      if (part.accepted) marks.push(make("span", { class: "badge good" }, "accepted"));
      else if (part.corrected) marks.push(make("span", { class: "badge good" }, "corrected"));
      else if (part.doubtful) marks.push(make("span", { class: "badge doubt" }, "doubtful"));
      const note = [joint ? joint.kind : "root", part.evidence && `from ${part.evidence}`,
        part.confidence !== null && `confidence ${part.confidence.toFixed(2)}`].filter(Boolean).join(", ");
      const card = make("li", { class: `card${part.name === chosen ? " chosen" : ""}`, "data-part": part.name },
        make("button", { type: "button", class: "head", onclick: () => choose(part.name) },
          make("span", { class: "name" }, part.name), ...marks),
        make("small", {}, note));
      if (moves) {
        const [low, high] = view.range(joint);
        card.append(make("div", { class: "slide" },
          make("input", { type: "range", min: low, max: high, step: "any", "data-slider": part.name, "aria-label": `position of ${part.name}`,
            oninput: (event) => { if (chosen !== part.name) choose(part.name, false); view.setPosition(part.name, Number(event.target.value)); } }),
          make("output", { "data-output": part.name })));
      }
      return card;
    }));
    for (const part of state.parts) if (part.joint) showPosition(part.name, view.position(part.name));
  }
  function showPosition(name, value) {
    const part = state.parts.find((p) => p.name === name);
    const slider = document.querySelector(`[data-slider="${CSS.escape(name)}"]`), output = document.querySelector(`[data-output="${CSS.escape(name)}"]`);
    if (!slider) return;
    if (Number(slider.value) !== value) slider.value = value;
    output.textContent = format(part.joint, value);
  }
  function choose(name, redraw = true) {
    leave();
    chosen = name;
    view.select(name);
    for (const card of $("list").children) card.classList.toggle("chosen", card.dataset.part === name);
    if (redraw) $("list").querySelector(".chosen")?.scrollIntoView({ block: "nearest" });
    showEditor();
  }

  // Modes of clicking.
  const TEXT = {
    edge: "Click the edge about which the part turns.",
    face: "Click a face that points in the direction of sliding.",
    axle: "Click a face that points along the axle; the axle goes through the middle of the part.",
    parent: "Click the part that this one is attached to.",
    merge: "Click the part that this one is a piece of.",
    paint: "Click or paint what becomes a part of its own; click again to remove it.",
  };
  function enter(next) {
    mode = next;
    view.setMode(next);
    $("mode-text").textContent = TEXT[next];
    $("mode").hidden = false;
    if (next !== "paint") view.clearPaint();
    showEditor();
  }
  function leave() {
    if (mode === "move") return;
    mode = "move";
    view.setMode("move");
    view.clearPaint();
    $("mode").hidden = true;
    showEditor();
  }
  async function click(hit) {
    const part = state.parts.find((p) => p.name === chosen);
    if (mode === "move") return choose(hit.part);
    if (mode === "paint" || !part) return undefined;
    if (mode === "parent") return hit.part === chosen ? undefined : edit("set_joint", { part: chosen, parent: hit.part });
    if (mode === "merge") return hit.part === chosen ? undefined : edit("merge_parts", { part: chosen, into: hit.part });
    let axis;
    try {
      axis = await request("snap", { part: hit.part === chosen || mode === "edge" ? hit.part : chosen, point: hit.point, normal: hit.normal, mode });
    } catch (error) {
      return message(error.message);
    }
    if (mode === "face") return edit("set_joint", { part: chosen, kind: "prismatic", axis_o: axis.axis });
    const kind = mode === "axle" ? (part.joint.kind === "revolute" ? "revolute" : "continuous") : "revolute";
    return edit("set_joint", { part: chosen, kind, axis_o: outward(part, axis, kind), pivot_o: axis.pivot });
  }
  // Direction of a hinge such that the middle of the part moves away from the middle of the object.
  function outward(part, axis, kind) {
    if (kind !== "revolute") return axis.axis;
    const middle = (b) => b[0].map((v, i) => 0.5 * (v + b[1][i]));
    const arm = new THREE.Vector3(...middle(part.bounds)).sub(new THREE.Vector3(...axis.pivot));
    const a = new THREE.Vector3(...axis.axis), away = new THREE.Vector3(...middle(part.bounds)).sub(new THREE.Vector3(...middle(state.bounds)));
    return a.clone().cross(arm).dot(away) < 0 ? a.negate().toArray() : a.toArray();
  }

  function section(title, ...children) { return [make("h2", {}, title), make("div", { class: "row" }, ...children)]; }
  function field(label, value, id, onset, unit) {
    const input = make("input", { type: "number", step: "any", id, value, "aria-label": label });
    input.addEventListener("change", () => { if (input.value !== "") onset(Number(input.value)); });
    return make("label", {}, `${label} `, input, ` ${unit}`);
  }

  function showEditor() {
    const part = state.parts.find((p) => p.name === chosen), editor = $("editor");
    if (!part) return editor.replaceChildren(make("p", { class: "note" }, "Select a part."));
    const name = part.name, joint = part.joint, desk = make("div", { class: "desk" });
    const set = (fields) => edit("set_joint", { part: name, ...fields });
    editor.replaceChildren(make("h2", { class: "own" }, name), make("p", { class: "note phone" }, "Corrections need a wider window."), desk);
    if (joint) {
      desk.append(make("div", { class: "row" }, button("Accept", () => edit("accept", { part: name }), { id: "accept", disabled: part.accepted })));
      desk.append(...section("Joint type", ...["revolute", "prismatic", "continuous", "fixed"].map((kind) =>
        button(kind, () => set({ kind }), { "aria-pressed": String(joint.kind === kind), "data-kind": kind }))));
      desk.append(...section("Candidates", ...part.candidates.map((entry) =>
        button(entry.label, () => edit(entry.edit.type, entry.edit), { "data-candidate": entry.label }))));
      desk.append(...section("Axis", ...[["edge", "Hinge edge"], ["face", "Sliding direction"], ["axle", "Axle"]].map(([next, label]) =>
        button(label, () => (mode === next ? leave() : enter(next)), { "aria-pressed": String(mode === next), "data-mode": next })),
        button("Reverse", () => set({ axis_o: joint.axis.map((v) => -v) }), { id: "reverse", disabled: joint.kind === "fixed" })));
    }
    if (joint && joint.lower !== null) {
      desk.append(...section("Limits",
        field("from", shown(joint, joint.lower).toFixed(1), "lower", (v) => set({ lower: stored(joint, v) }), unit(joint)),
        field("to", shown(joint, joint.upper).toFixed(1), "upper", (v) => set({ upper: stored(joint, v) }), unit(joint)),
        button("Closed here", () => closed(name), { id: "closed" }),
        button("Open here", () => edit("set_open", { part: name, q: view.position(name) }), { id: "open" })));
      desk.append(make("p", { class: "note" }, "Or pull the green and orange handles in the view."));
    }
    desk.append(...section("Size", sizeFields(name)));
    desk.append(...section("Parts",
      ...(joint ? [button("Merge into …", () => enter("merge"), { "data-mode": "merge", "aria-pressed": String(mode === "merge") }),
        button("Attach to …", () => enter("parent"), { "data-mode": "parent", "aria-pressed": String(mode === "parent") })] : []),
      button("Split …", () => enter("paint"), { "data-mode": "paint", "aria-pressed": String(mode === "paint") })));
    if (mode === "paint") desk.prepend(splitFields(name));
    return undefined;
  }
  async function closed(name) {
    const q = view.position(name);
    if (await edit("set_closed", { part: name, q })) view.setPosition(name, 0);
  }
  function sizeFields(name) {
    const of = make("select", { id: "size-of", "aria-label": "what is measured" }, make("option", { value: "" }, "object"), make("option", { value: name }, name));
    const axis = make("select", { id: "size-axis", "aria-label": "dimension" }, ...["length in x", "length in y", "height"].map((t, k) => make("option", { value: k, selected: k === 2 }, t)));
    const input = make("input", { type: "number", min: 1, step: "any", id: "size", "aria-label": "real dimension in mm" });
    const fill = () => {
      const bounds = of.value ? state.parts.find((p) => p.name === of.value).bounds : state.bounds;
      input.value = (1000 * (bounds[1][axis.value] - bounds[0][axis.value])).toFixed(0);
    };
    of.addEventListener("change", fill);
    axis.addEventListener("change", fill);
    fill();
    const go = button("Set", () => edit("set_size", { axis: Number(axis.value), size_m: Number(input.value) / 1000, ...(of.value ? { part: of.value } : {}) }), { id: "set-size" });
    return make("div", { class: "row" }, of, axis, input, make("span", {}, "mm"), go);
  }
  function splitFields(name) {
    let free = 2;
    while (state.parts.some((p) => p.name === `${name}_${free}`)) free++;
    const input = make("input", { id: "split-name", value: `${name}_${free}`, "aria-label": "name of the new part" });
    const grains = [["mesh", "Meshes"], ["piece", "Connected pieces"], ["face", "Faces"]];
    return make("div", {}, make("div", { class: "row" }, ...grains.map(([value, label]) =>
      button(label, () => { grain = value; showEditor(); }, { "aria-pressed": String(grain === value), "data-grain": value }))),
    make("div", { class: "row" }, make("label", {}, "name ", input),
      button("Make part", () => { const faces = view.selection(); const n = input.value; edit("split_part", { part: name, name: n, faces }).then((ok) => ok && choose(n)); }, { id: "make-part", class: "primary" })));
  }

  let evidence = "";
  function showEvidence() {
    const key = JSON.stringify([state.inputs, state.reasons]);
    if (key !== evidence) {
      evidence = key;
      $("inputs").replaceChildren(...state.inputs.map((mime, k) => (mime.startsWith("video/")
        ? make("video", { src: `input/${k}`, controls: true, loop: true, muted: true, playsInline: true, autoplay: true })
        : make("img", { src: `input/${k}`, alt: "the input" }))));
      if (!state.inputs.length) $("inputs").append(make("p", { class: "note" }, "No video or image; add one with --input."));
      $("reasons").replaceChildren(...state.reasons.map((text) => make("li", {}, text)));
      $("assumed").hidden = !state.assumptions.length;
      $("assumptions").replaceChildren(...state.assumptions.map((text) => make("li", {}, text)));
      $("trace").hidden = !state.trace;
    }
    const earlier = state.earlier ? [make("li", {}, `${state.earlier} earlier edits`)] : [];
    $("history").replaceChildren(...earlier, ...state.history.map((text) => make("li", {}, text)));
    if (!state.history.length && !earlier.length) $("history").append(make("li", {}, "No corrections."));
  }

  async function exportObject() {
    $("export").disabled = true;
    $("export").textContent = "Exporting …";
    if (await send("export")) {
      const good = GOOD.includes(state.check.verdict);
      message(`Exported to ${state.out}${good ? "" : `; the checks ended with: ${state.check.verdict}`}`, good);
    }
    $("export").disabled = false;
    $("export").textContent = "Export";
  }

  async function poll() {
    if (!sending && state && state.check && (state.check.state === "running" || state.check.revision !== state.revision)) {
      const check = await request("check").catch(() => null);
      if (check && !sending) { state.check = check; showCheck(); }
    }
    setTimeout(poll, 700);
  }

  async function start() {
    try {
      view = makeView(document.querySelector("canvas"), {
        click, move: showPosition, grain: () => grain, editable: () => window.innerWidth > 700,
        limits: (part, joint) => edit("set_joint", { part, lower: joint.lower, upper: joint.upper }),
      });
    } catch (error) {
      $("trouble").hidden = false;
      $("trouble").textContent = `This browser shows no 3-D (${error.message}).`;
      return;
    }
    $("undo").addEventListener("click", () => { leave(); send("undo"); });
    $("redo").addEventListener("click", () => { leave(); send("redo"); });
    $("export").addEventListener("click", exportObject);
    $("cancel").addEventListener("click", leave);
    $("reset").addEventListener("click", () => view.resetView());
    $("all").addEventListener("click", () => {
      const open = $("all").getAttribute("aria-pressed") !== "true";
      $("all").setAttribute("aria-pressed", String(open));
      $("all").textContent = open ? "Close all" : "Open all";
      for (const part of state.parts) {
        if (!part.joint || part.joint.kind === "fixed") continue;
        const [low, high] = view.range(part.joint);
        view.setPosition(part.name, open ? (Math.abs(high) >= Math.abs(low) ? high : low) : 0);
      }
    });
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape") leave();
      if (!(event.ctrlKey || event.metaKey) || event.target.tagName === "INPUT") return;
      if (event.key === "z") send(event.shiftKey ? "redo" : "undo");
      else if (event.key === "y") send("redo");
      else return;
      event.preventDefault();
    });
    try {
      await show(await request("state"));
    } catch (error) {
      message(error.message);
    }
    window.studio = { view, choose, state: () => state, mode: () => mode };
    poll();
  }
  start();
})();
