"use strict";
(() => {
  // ------------------------------------------------------------ photo against model
  for (const input of document.querySelectorAll(".compare input")) {
    input.addEventListener("input", () => input.parentElement.style.setProperty("--split", input.value + "%"));
  }

  // ------------------------------------------------------------ enlarging a picture
  const large = document.getElementById("large");
  for (const button of document.querySelectorAll("button.zoom")) {
    button.addEventListener("click", () => {
      const [from, to] = [button.querySelector("img"), large.querySelector("img")];
      [to.src, to.alt] = [from.src, from.alt];
      large.showModal();
    });
  }
  large.addEventListener("click", event => event.target === event.currentTarget && large.close());
  large.querySelector("form").addEventListener("submit", event => { event.preventDefault(); large.close(); });

  // ------------------------------------------------------------ choosing a boll
  const rows = new Map([...document.querySelectorAll("tr[data-boll]")].map(row => [row.dataset.boll, row]));
  const panel = document.getElementById("chosen");
  let mark = () => {};

  function choose(id) {
    for (const [other, row] of rows) {
      row.classList.toggle("chosen", other === id);
      row.querySelector("button").setAttribute("aria-pressed", String(other === id));
    }
    const row = rows.get(id);
    if (!row) return;
    if (panel) describe(row, id);
    mark(id);
  }

  function describe(row, id) {
    const heading = document.createElement("h3");
    heading.append(row.querySelector(".swatch").cloneNode(), "Boll " + id);
    const list = document.createElement("dl");
    const heads = row.closest("table").tHead.rows[0].cells;
    for (let column = 1; column < 8; column++) {
      const [term, value] = [document.createElement("dt"), document.createElement("dd")];
      term.textContent = heads[column].textContent;
      value.textContent = row.cells[column].textContent;
      list.append(term, value);
    }
    const doubts = document.createElement("p");
    doubts.className = "yellow";
    doubts.textContent = row.cells[row.cells.length - 2].textContent;
    const pictures = document.createElement("div");
    pictures.className = "big";
    pictures.append(...[...row.querySelectorAll(".cuts img")].map(image => image.cloneNode()));
    panel.replaceChildren(heading, list, doubts, pictures);
  }

  function chooseBranch(line) {
    const heading = document.createElement("h3");
    heading.textContent = line.name;
    const words = document.createElement("p");
    words.textContent = line.text;
    const pictures = document.createElement("div");
    pictures.className = "big";
    for (const [id, row] of rows) {
      const own = line.bolls.includes(Number(id));
      row.classList.toggle("chosen", own);
      if (own) pictures.append(...[...row.querySelectorAll(".cuts img")].map(image => image.cloneNode()));
    }
    panel?.replaceChildren(heading, words, pictures);
  }

  for (const [id, row] of rows) row.addEventListener("click", () => choose(id));

  // ------------------------------------------------------------ mending bolls
  function place(id) {
    const centre = rows.get(id).dataset.centre;
    return { boll_id: Number(id), ...(centre ? { centre_cm: JSON.parse(centre) } : {}) };
  }

  function mend(kind, id) {
    const chosen = document.querySelector("tr.chosen")?.dataset.boll;
    if (kind === "merge" && (!chosen || chosen === id)) return choose(id);
    const bolls = kind === "merge" ? [chosen, id] : [id];
    corrections.add({ words: `${kind} ${bolls.join(" + ")}`, saved: { kind, bolls: bolls.map(place) }, bolls });
  }

  corrections.onChange(items => {
    const mended = new Set(items.flatMap(item => item.bolls));
    for (const [id, row] of rows) row.classList.toggle("mended", mended.has(id));
  });
  for (const button of document.querySelectorAll("[data-mend]")) {
    button.addEventListener("click", event => {
      event.stopPropagation();
      mend(button.dataset.mend, button.closest("tr").dataset.boll);
    });
  }

  // ------------------------------------------------------------ the plant in 3D
  const element = document.getElementById("scene");
  const source = document.getElementById("scene_data");
  if (!element || !source) return;
  const data = JSON.parse(source.textContent);

  function sorry(why) {
    const text = document.createElement("p");
    text.className = "fallback";
    text.textContent = why + " The numbered photos above and the table below show the same bolls.";
    element.replaceChildren(text);
    document.querySelector(".tools").hidden = true;
  }

  if (!window.Plotly) return sorry("The 3D view needs the Python package plotly, which was not installed.");
  if (!document.createElement("canvas").getContext("webgl")) {
    return sorry("This browser shows no 3D (WebGL is off or missing).");
  }

  const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0)).buffer;
  const cloud = (points, size) => {
    const [x, y, z] = points.places.map(text => new Float32Array(bytes(text)));
    const rgb = new Uint8Array(bytes(points.colours));
    const colours = Array.from({ length: points.n }, (_, i) => `rgb(${rgb[3 * i]},${rgb[3 * i + 1]},${rgb[3 * i + 2]})`);
    return { type: "scatter3d", mode: "markers", x, y, z, hoverinfo: "skip", marker: { size, color: colours, line: { width: 0 } } };
  };
  const traces = [cloud(data.plant, 2.2), { ...cloud(data.lint, 2.2), visible: !data.bolls.length }];
  if (data.ground) traces.push(cloud(data.ground, 1.6));
  if (data.table) {
    const [x, y, z] = [0, 1, 2].map(axis => [...data.table, data.table[0]].map(corner => corner[axis]));
    traces.push({ type: "scatter3d", mode: "lines", x, y, z, hoverinfo: "skip", line: { color: "#8a7f70", width: 4 } });
  }
  const firstBody = traces.length;
  const cell = (id, column) => rows.get(String(id))?.cells[column].textContent ?? "–";
  for (const boll of data.bolls) {
    const [x, y, z] = boll.corners.map(text => new Float32Array(bytes(text)));
    const [i, j, k] = boll.triangles.map(text => new Int32Array(bytes(text)));
    traces.push({
      type: "mesh3d", x, y, z, i, j, k, color: boll.colour, meta: String(boll.id), flatshading: false,
      lighting: { ambient: 0.6, diffuse: 0.7, specular: 0.1 },
      hovertemplate: `Boll ${boll.id}<br>${cell(boll.id, 1)} cm³<br>height ${cell(boll.id, 3)} cm<extra></extra>`,
    });
  }
  const bodies = data.bolls.map((_, n) => firstBody + n);
  const [cx, cy, cz] = [0, 1, 2].map(axis => data.bolls.map(boll => boll.centre[axis]));
  traces.push({
    type: "scatter3d", mode: "text", x: cx, y: cy, z: cz, text: data.bolls.map(boll => String(boll.id)),
    textposition: "top center", textfont: { size: 13 }, hoverinfo: "skip",
  });
  traces.push({
    type: "scatter3d", mode: "markers", x: [], y: [], z: [], hoverinfo: "skip",
    marker: { size: 24, symbol: "circle-open", color: "#e6007a", line: { width: 3 } },
  });
  const ring = traces.length - 1;
  const lines = new Map(data.skeleton.map(line => ["line " + line.name, line]));
  const firstLine = traces.length;
  for (const [meta, line] of lines) {
    const [x, y, z] = line.places;
    traces.push({
      type: "scatter3d", mode: "lines", x, y, z, meta, line: { color: line.colour, width: 6 },
      text: x.map(() => line.text), hovertemplate: "%{text}<extra></extra>", connectgaps: false,
    });
  }

  const rod = traces.length;
  traces.push({
    type: "scatter3d", mode: "lines+markers", x: [], y: [], z: [], hoverinfo: "skip",
    marker: { size: 5, color: "#e6007a" }, line: { color: "#e6007a", width: 5 },
  });

  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const style = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const axis = name => ({
    title: { text: `${name} ${data.unit}` }, color: style("--soft"), gridcolor: style("--line"),
    zerolinecolor: style("--line"), showbackground: false, showspikes: false,
  });
  const eyes = { side: { x: 0.15, y: -1.25, z: 0.3 }, front: { x: 1.25, y: -0.15, z: 0.3 }, top: { x: 0, y: -0.05, z: 1.6 } };
  const camera = name => ({ eye: eyes[name], center: { x: 0, y: 0, z: data.table ? 0.05 : 0 } });
  const layout = () => ({
    margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, hovermode: "closest",
    paper_bgcolor: style("--scene"), font: { color: style("--ink") },
    scene: {
      aspectmode: "data", camera: camera("side"), bgcolor: style("--scene"), dragmode: "orbit",
      xaxis: axis("x"), yaxis: axis("y"), zaxis: axis("height"),
    },
  });
  const config = { responsive: true, displaylogo: false, modeBarButtons: [["toImage", "zoom3d", "pan3d", "orbitRotation", "resetCameraDefault3d"]] };

  Plotly.newPlot(element, traces, layout(), config).then(() => {
    element.dataset.drawn = "yes";
    const boll = event => event.points.map(point => point.data.meta).find(Boolean);
    let touched, spot, pressed;
    function touch(id, point) {
      [touched, spot] = [id, point && [point.x, point.y, point.z]];
      for (const [other, row] of rows) row.classList.toggle("touched", other === id);
    }
    element.on("plotly_hover", event => touch(boll(event), event.points[0]));
    element.on("plotly_unhover", () => touch());
    // Not plotly_click: it needs a frame to be drawn while the button is down, and slow machines lose clicks.
    element.addEventListener("pointerdown", event => { pressed = { id: touched, spot, x: event.x, y: event.y }; }, true);
    element.addEventListener("pointerup", event => {
      const still = pressed && Math.hypot(event.x - pressed.x, event.y - pressed.y) < 5;
      if (!still) return;
      if (measuring()) return pressed.spot && measure(pressed.spot);
      if (!pressed.id) return;
      lines.has(pressed.id) ? chooseBranch(lines.get(pressed.id)) : choose(pressed.id);
    }, true);

    const ruler = document.getElementById("ruler");
    const measured = document.getElementById("measured");
    const points = traces.map((_, n) => n).filter(n => traces[n].mode === "markers" && n !== ring);
    const measuring = () => ruler?.getAttribute("aria-pressed") === "true";
    let ends = [];
    function drawRod() {
      Plotly.restyle(element, Object.fromEntries(["x", "y", "z"].map((a, n) => [a, [ends.map(end => end[n])]])), [rod]);
    }
    function measure(at) {
      ends = ends.length === 2 ? [at] : [...ends, at];
      drawRod();
      measured.textContent = "Now the other end.";
      if (ends.length < 2) return;
      const words = corrections.length(...ends, [data.pixel, data.pixel], data.relative_error);
      measured.textContent = words.replace("ruler ", "");
      corrections.add({ words, saved: { kind: "ruler", bolls: ends.map(end => ({ centre_cm: end })) }, marks: ends });
    }
    corrections.onChange(items => {
      if (ends.length < 2 || items.some(item => item.marks === ends)) return;
      ends = [];
      drawRod();
      measured.textContent = "";
    });
    ruler?.addEventListener("click", () => {
      ruler.setAttribute("aria-pressed", String(!measuring()));
      Plotly.restyle(element, { hoverinfo: measuring() ? "none" : "skip" }, points);
      ends = [];
      drawRod();
      measured.textContent = measuring() ? "Click one end on the plant." : "";
    });
    mark = id => {
      const found = data.bolls.find(item => String(item.id) === id);
      if (found) Plotly.restyle(element, Object.fromEntries(["x", "y", "z"].map((a, n) => [a, [[found.centre[n]]]])), [ring]);
    };
    for (const button of document.querySelectorAll("[data-eye]")) {
      button.addEventListener("click", () => Plotly.relayout(element, { "scene.camera": camera(button.dataset.eye) }));
    }
    const toggle = document.getElementById("bodies");
    toggle?.addEventListener("click", () => {
      const shown = toggle.getAttribute("aria-pressed") !== "true";
      toggle.setAttribute("aria-pressed", String(shown));
      Plotly.restyle(element, { visible: [...bodies.map(() => shown), !shown] }, [...bodies, 1]);
    });
    const skeleton = document.getElementById("skeleton");
    skeleton?.addEventListener("click", () => {
      const shown = skeleton.getAttribute("aria-pressed") !== "true";
      skeleton.setAttribute("aria-pressed", String(shown));
      Plotly.restyle(element, { visible: shown }, data.skeleton.map((_, n) => firstLine + n));
    });
    dark.addEventListener("change", () => {
      const { paper_bgcolor, font, scene } = layout();
      Plotly.relayout(element, {
        paper_bgcolor, font, "scene.bgcolor": scene.bgcolor,
        ...Object.fromEntries(["xaxis", "yaxis", "zaxis"].flatMap(name =>
          ["color", "gridcolor", "zerolinecolor"].map(key => [`scene.${name}.${key}`, scene[name][key]]))),
      });
    });
  }).catch(error => sorry("The 3D view could not be drawn (" + error + ")."));
})();
