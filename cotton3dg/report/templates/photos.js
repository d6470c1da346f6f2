"use strict";
// Pointing in photos: two clicks in photos from different sides show a point in space. All places are the page's.
(() => {
  const source = document.getElementById("photos_data");
  if (!source) return;
  const data = JSON.parse(source.textContent);
  const { photos } = data;

  // ------------------------------------------------------------ geometry
  const dot = (a, b) => a.reduce((sum, x, n) => sum + x * b[n], 0);
  const minus = (a, b) => a.map((x, n) => x - b[n]);
  const along = (a, direction, far) => a.map((x, n) => x + far * direction[n]);
  const length = a => Math.hypot(...a);
  const unit = a => a.map(x => x / length(a));

  function rayOf(photo, [x, y]) {
    const inCamera = [(x - photo.middle[0]) / photo.focal[0], (y - photo.middle[1]) / photo.focal[1], 1];
    return unit(photo.rays.map(row => dot(row, inCamera)));
  }

  // Pixel of a place; undefined behind the camera.
  function project(photo, place) {
    const [x, y, z] = photo.pose.map(row => dot(row, [...place, 1]));
    return z > 0 ? [photo.middle[0] + photo.focal[0] * x / z, photo.middle[1] + photo.focal[1] * y / z] : undefined;
  }

  // The place midway between two rays where they are nearest, with its standard error for picks good to a pixel or
  // to what they miss each other by; or why there is none.
  function meet(picks) {
    const [a, b] = picks.map(pick => ({ from: photos[pick.photo].centre, ray: rayOf(photos[pick.photo], pick.at) }));
    const cosine = dot(a.ray, b.ray);
    if (Math.abs(cosine) > Math.cos(data.least_angle)) return { why: "Both photos look from the same side; take another one." };
    const between = minus(b.from, a.from);
    const [farA, farB] = [[a, b], [b, a]].map(([own, other], n) =>
      (n ? -1 : 1) * (dot(between, own.ray) - cosine * dot(between, other.ray)) / (1 - cosine * cosine));
    const ends = [along(a.from, a.ray, farA), along(b.from, b.ray, farB)];
    const place = ends[0].map((x, n) => (x + ends[1][n]) / 2);
    const missed = picks.map(pick => {
      const seen = project(photos[pick.photo], place);
      return seen ? length(minus(seen, pick.at)) / Math.max(1, photos[pick.photo].size[0] / data.full_width_px) : Infinity;
    });
    if (Math.max(...missed) >= data.slip_px) return { why: "The two clicks do not meet in space; the second belongs on the line." };
    return { place, error: spread(picks, place) * Math.max(1, Math.hypot(...missed) / Math.SQRT2) };
  }

  // Standard error of a place, mean of three axes, if each pick errs by a pixel in x and in y.
  function spread(picks, place) {
    const step = 1e-4 * length(minus(photos[picks[0].photo].centre, place));
    const slopes = picks.flatMap(pick => {
      const moved = [0, 1, 2].map(axis => [step, -step].map(by =>
        project(photos[pick.photo], place.map((x, n) => x + (n === axis ? by : 0)))));
      return [0, 1].map(side => moved.map(([ahead, behind]) => (ahead[side] - behind[side]) / (2 * step)));
    });
    const m = [0, 1, 2].map(i => [0, 1, 2].map(j => slopes.reduce((sum, row) => sum + row[i] * row[j], 0)));
    const minor = (i, j) => m[i][i] * m[j][j] - m[i][j] ** 2;
    const determinant = m[0][0] * minor(1, 2) - m[0][1] * (m[0][1] * m[2][2] - m[1][2] * m[0][2])
      + m[0][2] * (m[0][1] * m[1][2] - m[1][1] * m[0][2]);
    return Math.sqrt((minor(0, 1) + minor(0, 2) + minor(1, 2)) / determinant / 3);
  }

  // ------------------------------------------------------------ what the clicks say
  const hint = document.getElementById("hint");
  const begun = {
    add: "Click the middle of the missed boll in either photo.",
    corner: "Click where a corner of the table really is, in either photo.",
    ruler: "Click one end of the length in either photo.",
  };
  let mode, picks = [], ends = [];

  function say(text, doubt = false) {
    hint.textContent = text;
    hint.classList.toggle("yellow", doubt);
  }

  function choose(kind) {
    [mode, picks, ends] = [kind === mode ? undefined : kind, [], []];
    for (const button of document.querySelectorAll("[data-point]")) {
      button.setAttribute("aria-pressed", String(button.dataset.point === mode));
    }
    for (const pane of panes) pane.svg.classList.toggle("pick", Boolean(mode));
    say(mode ? begun[mode] : "Choose what to do.");
    draw();
  }

  const saved = (pick, end) => {
    const { name, sha256 } = photos[pick.photo];
    const [x, y] = pick.at.map(value => Math.round(value * 100) / 100);
    return { image: name, x_px: x, y_px: y, sha256, ...(end ? { end } : {}) };
  };

  const finish = {
    add({ place }) {
      corrections.add({
        words: "add a boll" + (data.unit === "cm" ? ` at height ${place[2].toFixed(1)} cm` : ""),
        saved: { kind: "add", picks: picks.map(pick => saved(pick)) }, marks: [place],
      });
      return "The boll is among the corrections. " + begun.add;
    },
    corner({ place }) {
      const width = length(minus(data.corners[2], data.corners[1]));
      if (Math.abs(place[2]) > data.off_table * width) {
        return say(`The clicks meet ${place[2].toFixed(1)} cm above the table top; click the same corner in both photos.`, true);
      }
      const away = data.corners.map(corner => length(minus(corner, place)));
      const nearest = away.indexOf(Math.min(...away));
      corrections.add({
        words: `corner ${nearest + 1} of the table moved by ${away[nearest].toFixed(1)} cm`,
        saved: { kind: "corner", picks: picks.map(pick => saved(pick)) }, marks: [place],
      });
      return "The corner is among the corrections. " + begun.corner;
    },
    ruler(end) {
      ends.push({ ...end, picks });
      if (ends.length < 2) return "Now the other end: click it in either photo.";
      const [a, b] = ends;
      const words = corrections.length(a.place, b.place, [a.error, b.error], data.relative_error);
      const named = ends.flatMap((item, n) => item.picks.map(pick => saved(pick, "ab"[n])));
      corrections.add({ words, saved: { kind: "ruler", picks: named }, marks: [a.place, b.place] });
      ends = [];
      return words.replace("ruler ", "") + ". " + begun.ruler;
    },
  };

  function click(photo, at) {
    if (!mode) return say("Choose what to do.", true);
    if (!picks.length || picks[0].photo === photo) {
      picks = [{ photo, at }];
      say("Now click the same point in the other photo: it lies on the line.");
    } else {
      picks = [picks[0], { photo, at }];
      const met = meet(picks);
      if (met.why) {
        say(met.why, true);
        picks.pop();
      } else {
        const result = finish[mode](met);
        if (result) say(result);
        picks = [];
      }
    }
    draw();
  }

  // ------------------------------------------------------------ the two photos
  const panes = [...document.querySelectorAll(".pane")].map((figure, n) => {
    const svg = figure.querySelector("svg");
    const first = Math.floor(n * photos.length / 4);
    return { figure, svg, image: svg.querySelector("image"), over: svg.querySelector("g"), shown: first, zoom: 1, at: [0, 0] };
  });
  const make = (name, attributes, text) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text !== undefined) element.textContent = text;
    return element;
  };
  let marked = [];
  corrections.onChange(items => { marked = items; draw(); });

  function show(pane) {
    const photo = photos[pane.shown];
    const [width, height] = photo.size;
    pane.image.setAttribute("href", photo.src);
    pane.image.setAttribute("width", width);
    pane.image.setAttribute("height", height);
    view(pane);
    pane.svg.setAttribute("aria-label", `Photo ${photo.name}; arrow keys move the cross, Enter clicks there`);
    pane.figure.querySelector(".named").textContent = `${pane.shown + 1} of ${photos.length}`;
  }

  // The part of the photo that is seen.
  function view(pane) {
    const size = photos[pane.shown].size.map(side => side / pane.zoom);
    pane.at = pane.at.map((x, n) => Math.min(Math.max(x, 0), photos[pane.shown].size[n] - size[n]));
    pane.svg.setAttribute("viewBox", [...pane.at, ...size].join(" "));
  }

  const plant = [0, 1, 2].map(n => data.bolls.reduce((sum, boll) => sum + boll[n + 1] / data.bolls.length, 0));

  // Where to look closer first: at the pick, at the part of its line that is nearest to the plant, or at the plant.
  function target(pane) {
    const [pick] = picks;
    if (!pick) return project(photos[pane.shown], plant);
    if (pick.photo === pane.shown) return pick.at;
    const { centre } = photos[pick.photo];
    const ray = rayOf(photos[pick.photo], pick.at);
    return project(photos[pane.shown], along(centre, ray, dot(minus(plant, centre), ray)));
  }

  function zoom(pane, factor) {
    const size = photos[pane.shown].size;
    const middle = (pane.zoom === 1 && target(pane)) || pane.at.map((x, n) => x + size[n] / pane.zoom / 2);
    pane.zoom = Math.min(Math.max(pane.zoom * factor, 1), 16);
    pane.at = middle.map((x, n) => x - size[n] / pane.zoom / 2);
    view(pane);
    draw();
  }

  function draw() {
    for (const pane of panes) {
      const photo = photos[pane.shown];
      const px = photo.size[0] / pane.zoom / (pane.svg.clientWidth || 640);  // on the screen
      const parts = [];
      const label = (at, text, kind, side = 1) => parts.push(make("text", {
        x: at[0] + side * 5 * px, y: at[1] + 5 * px, style: `font-size: ${14 * px}px`, class: kind,
        "text-anchor": side > 0 ? "start" : "end",
      }, text));
      const cross = (at, kind) => parts.push(make("path", {
        d: `M${at[0] - 9 * px} ${at[1]}h${18 * px}M${at[0]} ${at[1] - 9 * px}v${18 * px}`, class: kind, "stroke-width": 2 * px,
      }));
      const line = (places, kind) => {
        const seen = places.map(place => project(photo, place)).filter(Boolean);
        if (seen.length > 1) parts.push(make("path", { d: "M" + seen.map(at => at.join(" ")).join("L"), class: kind, "stroke-width": 2 * px }));
      };
      // The nearest bolls first: a number that would lie on another is not drawn until the photo is enlarged.
      const known = data.bolls.map(([id, ...place]) => ({ id, at: project(photo, place), away: length(minus(place, photo.centre)) }));
      const numbered = [];
      const dots = known.map(({ at }) => at).filter(Boolean);
      for (const { id, at } of known.filter(({ at }) => at).sort((a, b) => a.away - b.away)) {
        parts.push(make("circle", { cx: at[0], cy: at[1], r: 2.5 * px, "stroke-width": px }));
        // To the left where another boll's dot would lie on it.
        const side = dots.some(dot => dot[0] > at[0] && dot[0] < at[0] + 24 * px && Math.abs(dot[1] - at[1]) < 9 * px) ? -1 : 1;
        const middle = at[0] + side * 14 * px;
        if (numbered.some(other => Math.abs(middle - other[0]) < 24 * px && Math.abs(at[1] - other[1]) < 15 * px)) continue;
        numbered.push([middle, at[1]]);
        label(at, id, "known", side);
      }
      if (data.corners.length) {
        line([...data.corners, data.corners[0]], "outline");
        data.corners.forEach((place, n) => { const at = project(photo, place); if (at) label(at, `corner ${n + 1}`, "corner"); });
      }
      for (const { marks } of marked) {
        for (const place of marks) { const at = project(photo, place); if (at) cross(at, "marked"); }
        if (marks.length > 1) line(marks, "marked");
      }
      for (const end of ends) { const at = project(photo, end.place); if (at) cross(at, "marked"); }
      for (const pick of picks) {
        if (pick.photo === pane.shown) cross(pick.at, "now");
        else {
          const from = photos[pick.photo].centre;
          const ray = rayOf(photos[pick.photo], pick.at);
          const far = length(from);
          line(Array.from({ length: 60 }, (_, n) => along(from, ray, far * (0.2 + n * 0.05))), "epipolar");
        }
      }
      if (pane.cursor) cross(pane.cursor, "cursor");
      pane.over.replaceChildren(...parts);
    }
  }

  function pixel(pane, event) {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(pane.svg.getScreenCTM().inverse());
    return [at.x, at.y];
  }

  function turn(pane, by) {
    const other = panes.find(item => item !== pane);
    do pane.shown = (pane.shown + by + photos.length) % photos.length; while (pane.shown === other.shown);
    show(pane);
    draw();
  }

  for (const pane of panes) {
    let pressed;
    pane.svg.addEventListener("pointerdown", event => {
      pressed = { x: event.clientX, y: event.clientY, at: pane.at };
      pane.svg.setPointerCapture(event.pointerId);
    });
    pane.svg.addEventListener("pointermove", event => {
      if (!pressed || pane.zoom === 1) return;
      const perPx = photos[pane.shown].size[0] / pane.zoom / pane.svg.clientWidth;
      pane.at = [pressed.at[0] - (event.clientX - pressed.x) * perPx, pressed.at[1] - (event.clientY - pressed.y) * perPx];
      view(pane);
    });
    pane.svg.addEventListener("pointerup", event => {
      const still = pressed && Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) < 5;
      pressed = undefined;
      pane.cursor = undefined;
      if (still) click(pane.shown, pixel(pane, event));
    });
    pane.svg.addEventListener("pointercancel", () => { pressed = undefined; });
    pane.svg.addEventListener("keydown", event => {
      const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!steps && event.key !== "Enter") return;
      event.preventDefault();
      const size = photos[pane.shown].size;
      pane.cursor ??= pane.at.map((x, n) => x + size[n] / pane.zoom / 2);
      if (steps) pane.cursor = pane.cursor.map((x, n) => x + steps[n] * (event.shiftKey ? 1 : size[0] / pane.zoom / 64));
      else click(pane.shown, pane.cursor);
      draw();
    });
    const buttons = { previous: () => turn(pane, -1), next: () => turn(pane, 1), closer: () => zoom(pane, 1.6), away: () => zoom(pane, 1 / 1.6) };
    for (const [name, act] of Object.entries(buttons)) {
      pane.figure.querySelector(`[data-act=${name}]`).addEventListener("click", act);
    }
    show(pane);
  }
  window.addEventListener("resize", draw);
  for (const button of document.querySelectorAll("[data-point]")) {
    button.addEventListener("click", () => choose(button.dataset.point));
  }
  draw();
})();
