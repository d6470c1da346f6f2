"use strict";
(() => {
  const plot = document.getElementById("scatter");
  const pointed = document.getElementById("pointed");
  const selects = ["x", "y"].map(axis => document.getElementById("scatter_" + axis));
  const rows = [...document.querySelectorAll("tr[data-plant]")];
  const [left, right, top, bottom] = [60, 630, 24, 225];

  function add(name, attributes, text) {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text !== undefined) element.textContent = text;
    plot.append(element);
    return element;
  }

  function span(values) {
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const margin = (high - low || Math.abs(high) || 1) * 0.06;
    return [low - margin, high + margin];
  }

  function draw() {
    plot.replaceChildren();
    const dots = rows.filter(row => !row.hidden).map(row => ({
      row,
      place: selects.map(select => row.querySelector(`[data-trait="${select.value}"]`).dataset.value),
    })).filter(dot => dot.place.every(value => value !== "")).map(dot => ({ ...dot, place: dot.place.map(Number) }));
    add("path", { class: "thin", d: `M${left} ${top}V${bottom}H${right}` });
    if (!dots.length) return add("text", { x: 300, y: 120 }, "no plant has both values");
    const [spanX, spanY] = [0, 1].map(axis => span(dots.map(dot => dot.place[axis])));
    const x = value => left + (right - left) * (value - spanX[0]) / (spanX[1] - spanX[0]);
    const y = value => bottom - (bottom - top) * (value - spanY[0]) / (spanY[1] - spanY[0]);
    for (let tick = 0; tick <= 4; tick++) {
      const [valueX, valueY] = [spanX, spanY].map(([low, high]) => low + (high - low) * (tick + 0.5) / 5);
      add("text", { x: x(valueX), y: bottom + 14, "text-anchor": "middle" }, Number(valueX.toPrecision(3)));
      add("text", { x: left - 6, y: y(valueY) + 3, "text-anchor": "end" }, Number(valueY.toPrecision(3)));
    }
    const names = selects.map(select => select.selectedOptions[0].textContent);
    add("text", { x: (left + right) / 2, y: bottom + 30, "text-anchor": "middle" }, names[0]);
    add("text", { x: left, y: top - 10 }, names[1]);
    for (const { row, place } of dots) {
      const kind = row.dataset.odd ? "dot odd" : "dot";
      const label = `${row.cells[1].textContent}: ${names[0]} ${place[0]}, ${names[1]} ${place[1]}`;
      const dot = add("circle", { class: kind, cx: x(place[0]), cy: y(place[1]), r: 6 });
      dot.append(Object.assign(document.createElementNS("http://www.w3.org/2000/svg", "title"), { textContent: label }));
      dot.addEventListener("pointerenter", () => { pointed.textContent = label; });
      dot.addEventListener("click", () => {
        for (const other of rows) other.classList.toggle("chosen", other === row);
        row.scrollIntoView({ block: "center" });
      });
    }
  }

  // ------------------------------------------------------------ the list to take along
  document.getElementById("print_list")?.addEventListener("click", () => {
    document.body.classList.add("only_list");
    window.print();
  });
  window.addEventListener("afterprint", () => document.body.classList.remove("only_list"));

  // ------------------------------------------------------------ choosing by the field book
  const filters = [...document.querySelectorAll("[data-filter]")];

  function filter() {
    for (const row of rows) {
      row.hidden = filters.some(select => select.value && row.dataset["field" + select.dataset.filter] !== select.value);
    }
    const shown = rows.filter(row => !row.hidden).length;
    document.getElementById("counted").textContent = `${shown} of ${rows.length} plants`;
    draw();
  }

  for (const select of filters) select.addEventListener("change", filter);
  for (const select of selects) select.addEventListener("change", draw);
  draw();
})();
