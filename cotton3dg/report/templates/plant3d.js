"use strict";
// The plant in 3D: its splats, over them bolls and branches as shapes that answer the pointer, above them the tools.
(() => {
  const element = document.getElementById("scene");
  const source = document.getElementById("scene_data");
  if (!element || !source) return;
  const data = JSON.parse(source.textContent);
  const NS = "http://www.w3.org/2000/svg";
  const [LINE_PX, LETTER_PX] = [17, 8.5];  // a number's height, and the width of a figure

  // The picture stays, with a word.
  function sorry(why) {
    const text = document.createElement("p");
    text.className = "fallback";
    text.textContent = why + " This is a picture of it; the numbered photos and the table show the same bolls.";
    element.replaceChildren(element.querySelector("img"), text);
    element.removeAttribute("tabindex");
    element.removeAttribute("role");
    element.closest("section").querySelector(".tools").hidden = true;
  }

  function make(name, parent, attributes = {}) {
    const made = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    parent.append(made);
    return made;
  }

  const floats = text => new Float32Array(Uint8Array.from(atob(text), letter => letter.charCodeAt(0)).buffer);
  const rgbOf = colour => colour.match(/\d+/g).map(Number);

  function show(cloud) {
    const canvas = document.createElement("canvas");
    const tip = Object.assign(document.createElement("div"), { className: "tip", hidden: true });
    const over = make("svg", element, { "aria-hidden": "true" });
    element.prepend(canvas);
    element.append(tip);
    const renderer = splats.renderer(canvas, cloud);
    let waiting = false;
    const orbit = orbiting.orbit(element, data.box, later);

    // ------------------------------------------------------------ what lies over the splats
    const lines = data.skeleton.map(line => ({ ...line, path: make("path", over, { class: "branch", stroke: line.colour }) }));
    const bodies = data.bolls.map(boll => {
      const axes = boll.corners.map(floats);
      const corners = axes.length ? Array.from(axes[0], (x, n) => [x, axes[1][n], axes[2][n]]) : [];
      const path = make("path", over, { class: "boll", stroke: boll.colour, "data-boll": boll.id });
      return { ...boll, corners, path, leader: make("path", over, { class: "leader" }), label: make("text", over) };
    });
    for (const body of bodies) body.label.textContent = body.id;
    const rod = make("path", over, { class: "rod" });

    // Where a view shows a place: x, y in px and the depth.
    function projector({ axes, eye, focal, width, height }) {
      return place => {
        const [x, y, z] = axes.map(axis => axis.reduce((sum, a, k) => sum + a * (place[k] - eye[k]), 0));
        return [width / 2 + focal * x / z, height / 2 + focal * y / z, z];
      };
    }

    function drawBody(body, project, focal) {
      const [x, y, depth] = project(body.centre);
      const seen = body.corners.map(project);
      const outline = seen.length ? outlineOf(seen) : circle(x, y, focal * body.radius / depth);
      const ys = outline.map(at => at[1]);
      const xs = outline.map(at => at[0]);
      body.path.setAttribute("d", `M${outline.map(at => `${at[0].toFixed(1)} ${at[1].toFixed(1)}`).join("L")}Z`);
      Object.assign(body, { x, y, depth, reach: [(Math.max(...xs) - Math.min(...xs)) / 2, (Math.max(...ys) - Math.min(...ys)) / 2] });
    }

    // Numbers beside their bolls, nearest first; one that finds no free place is left out.
    function number(sorted, { width, height }) {
      const taken = [];
      for (const { label, leader, x, y, reach, id } of sorted) {
        const size = [LETTER_PX * String(id).length + 3, LINE_PX];
        const spot = spots(x, y, reach, size).find(({ at }) => inside(at, size, width, height) && taken.every(other => apart(at, size, other)));
        label.toggleAttribute("hidden", !spot);
        leader.setAttribute("d", spot?.ring ? `M${x} ${y}L${spot.at}` : "");
        if (!spot) continue;
        taken.push({ at: spot.at, size });
        label.setAttribute("x", spot.at[0]);
        label.setAttribute("y", spot.at[1] + 5);
      }
    }

    function draw() {
      waiting = false;
      const view = orbit.view();
      if (!view.width) return;
      renderer.draw(view, Math.min(window.devicePixelRatio, 2));
      const project = projector(view);
      over.setAttribute("viewBox", `0 0 ${view.width} ${view.height}`);
      for (const { path, places: [x, y, z] } of lines) {
        let pen = "M";
        path.setAttribute("d", x.map((_, n) => {
          if (x[n] === null) { pen = "M"; return ""; }
          const [across, down] = project([x[n], y[n], z[n]]);
          const step = `${pen}${across.toFixed(1)} ${down.toFixed(1)}`;
          pen = "L";
          return step;
        }).join(""));
      }
      for (const body of bodies) drawBody(body, project, view.focal);
      const sorted = [...bodies].sort((a, b) => a.depth - b.depth);
      // The nearest answers the pointer: it stands last.
      for (const body of sorted) over.insertBefore(body.path, lines.at(-1)?.path.nextSibling ?? over.firstChild);
      number(sorted, view);
      rod.setAttribute("d", ends.length ? `M${ends.map(end => project(end).slice(0, 2)).join("L")}h.01` : "");
      element.dataset.drawn = "yes";
    }

    function later() {
      if (!waiting) requestAnimationFrame(draw);
      waiting = true;
    }

    // ------------------------------------------------------------ pointing
    const told = path => {
      if (path.dataset.boll) return picking.tell(path.dataset.boll);
      return lines.find(line => line.path === path)?.text;
    };
    const shapeAt = event => event.target.closest?.(".boll, .branch");
    element.addEventListener("pointermove", event => {
      const shape = shapeAt(event);
      picking.touch(shape?.dataset.boll);
      tip.hidden = !shape || event.buttons > 0;
      if (tip.hidden) return;
      tip.textContent = told(shape);
      const [x, y] = orbit.place(event);
      tip.style.translate = `${Math.min(x + 14, element.clientWidth - tip.offsetWidth - 4)}px ${Math.max(y - 40, 4)}px`;
    });
    element.addEventListener("pointerleave", () => { tip.hidden = true; picking.touch(); });
    element.addEventListener("click", event => {
      if (orbit.dragged()) return;
      if (measuring()) return measure(event);
      const shape = shapeAt(event);
      if (shape?.dataset.boll) picking.choose(shape.dataset.boll);
      else if (shape) picking.chooseBranch(lines.find(line => line.path === shape));
    });
    picking.onChoose(id => {
      for (const body of bodies) body.path.classList.toggle("chosen", String(body.id) === id);
    });

    // ------------------------------------------------------------ a length
    const ruler = document.getElementById("ruler");
    const measured = document.getElementById("measured");
    const measuring = () => ruler?.getAttribute("aria-pressed") === "true";
    let ends = [];
    function measure(event) {
      const { axes, eye, focal, width, height } = orbit.view();
      const [x, y] = orbit.place(event);
      const ray = axes[2].map((ahead, k) => ahead + (axes[0][k] * (x - width / 2) + axes[1][k] * (y - height / 2)) / focal);
      const at = splats.touch(cloud, eye, ray);
      if (!at) { measured.textContent = "Nothing is there: click on the plant."; return; }
      ends = ends.length === 2 ? [at] : [...ends, at];
      later();
      measured.textContent = "Now the other end.";
      if (ends.length < 2) return;
      const words = corrections.length(...ends, [data.pixel, data.pixel], data.relative_error);
      measured.textContent = words.replace("ruler ", "");
      corrections.add({ words, saved: { kind: "ruler", bolls: ends.map(end => ({ centre_cm: end })) }, marks: ends });
    }
    function forget() {
      [ends, measured.textContent] = [[], measuring() ? "Click one end on the plant." : ""];
      later();
    }
    corrections.onChange(items => { if (ends.length === 2 && items.every(item => item.marks !== ends)) forget(); });

    // ------------------------------------------------------------ tools
    function toggle(id, act) {
      const button = document.getElementById(id);
      button?.addEventListener("click", () => {
        const on = button.getAttribute("aria-pressed") !== "true";
        button.setAttribute("aria-pressed", String(on));
        act(on);
      });
    }
    toggle("ruler", forget);
    toggle("bodies", on => { renderer.paint(on ? coloured(cloud) : cloud.rgba); later(); });
    toggle("outlines", on => over.classList.toggle("plain", !on));
    toggle("skeleton", on => over.classList.toggle("bones", on));
    for (const button of document.querySelectorAll("[data-eye]")) {
      button.addEventListener("click", () => orbit.face(button.dataset.eye));
    }
    new ResizeObserver(later).observe(element);
    canvas.addEventListener("webglcontextrestored", later);
    orbit.face("side");
    remember(orbit);
    Object.assign(element, { where: place => projector(orbit.view())(place), view: orbit.view });
  }

  // After a correction the page is read anew: the plant stays as it was turned.
  function remember(orbit) {
    if (!("view" in document.documentElement.dataset)) return;
    const key = `pose of ${location.pathname}`;
    const former = sessionStorage.getItem(key);
    if (former) orbit.take(JSON.parse(former));
    window.addEventListener("pagehide", () => sessionStorage.setItem(key, JSON.stringify(orbit.pose())));
  }

  // Bolls in the colours of their rows, as light and dark as they were filmed.
  function coloured({ n, rgba, owners }) {
    const own = new Map(data.bolls.map(boll => [boll.id, rgbOf(boll.colour)]));
    const painted = rgba.slice();
    for (let i = 0; i < n; i++) {
      const colour = own.get(owners[i]);
      if (!colour) continue;
      const light = Math.max(rgba[4 * i], rgba[4 * i + 1], rgba[4 * i + 2]) / 255;
      for (let k = 0; k < 3; k++) painted[4 * i + k] = Math.round(colour[k] * (0.25 + 0.75 * light));
    }
    return painted;
  }

  // ------------------------------------------------------------ shapes on the screen
  // The convex outline of points (Andrew 1979).
  function outlineOf(points) {
    const sorted = points.slice().sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const half = list => {
      const kept = [];
      for (const p of list) {
        while (kept.length > 1 && !left(kept.at(-2), kept.at(-1), p)) kept.pop();
        kept.push(p);
      }
      return kept.slice(0, -1);
    };
    return [...half(sorted), ...half(sorted.reverse())];
  }
  const left = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0;
  const circle = (x, y, radius) => Array.from({ length: 24 }, (_, n) =>
    [x + radius * Math.cos(n * Math.PI / 12), y + radius * Math.sin(n * Math.PI / 12)]);

  // Middles of a number around its boll, the best first; ring 0 touches the boll and needs no line to it.
  function spots(x, y, reach, size) {
    return [0, 1, 2, 3].flatMap(ring => [0, 4, 2, 6, 1, 7, 3, 5].map(direction => {
      const angle = direction * Math.PI / 4;
      const away = reach.map((r, k) => r + size[k] / 2 + 1 + 16 * ring);
      return { ring, at: [x + away[0] * Math.sin(angle), y - away[1] * Math.cos(angle)] };
    }));
  }
  const inside = (at, size, width, height) =>
    at[0] > size[0] / 2 && at[0] < width - size[0] / 2 && at[1] > size[1] / 2 && at[1] < height - size[1] / 2;
  const apart = (at, size, other) => [0, 1].some(k => Math.abs(at[k] - other.at[k]) >= (size[k] + other.size[k]) / 2);

  if (!document.createElement("canvas").getContext("webgl2")) return sorry("This browser shows no 3D (WebGL 2 is off or missing).");
  if (!window.DecompressionStream) return sorry("This browser is too old for the 3D view.");
  splats.unpack(data.splats).then(show).catch(error => sorry(`The 3D view could not be drawn (${error}).`));
})();
