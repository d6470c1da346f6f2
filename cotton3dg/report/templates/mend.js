"use strict";
// What a person says of the plant, in order: listed, taken back, saved as corrections.json.
const corrections = (() => {
  const items = [];
  const listeners = [];
  const panel = document.getElementById("mending");

  function update() {
    panel.hidden = !items.length;
    const list = document.getElementById("correction_list");
    list.replaceChildren(...items.map(({ words }) => Object.assign(document.createElement("li"), { textContent: words })));
    list.scrollTop = list.scrollHeight;
    for (const listener of listeners) listener(items);
  }

  document.getElementById("undo").addEventListener("click", () => { items.pop(); update(); });
  document.getElementById("save").addEventListener("click", () => {
    const text = JSON.stringify({ corrections: items.map(({ saved }) => saved) }, null, 1) + "\n";
    const href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
    Object.assign(document.createElement("a"), { href, download: "corrections.json" }).click();
  });

  return {
    // words: for people; saved: as corrections.json has it; bolls: numbers that it is about; marks: places to draw.
    add(item) { items.push({ bolls: [], marks: [], ...item }); update(); },
    onChange(listener) { listeners.push(listener); },
    // A length in words; its error is of its ends and of the scale.
    length(a, b, endErrors, relativeError) {
      const cm = Math.hypot(...a.map((x, n) => x - b[n]));
      const error = Math.hypot(...endErrors, cm * relativeError);
      return `ruler ${cm.toFixed(2)} ± ${error.toFixed(2)} cm`;
    },
  };
})();
