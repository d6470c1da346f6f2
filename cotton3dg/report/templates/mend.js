"use strict";
// What a person says of the plant, in order: listed, taken back, saved as corrections.json. `cotton3dg view` marks the
// page: there it applies at once.
const corrections = (() => {
  const READ_MS = 15000;
  const items = [];
  const listeners = [];
  const panel = document.getElementById("mending");
  const [undo, save, note] = [document.getElementById("undo"), document.getElementById("save"), panel.querySelector("p")];
  const served = "view" in document.documentElement.dataset;
  let kept = [], turn = Promise.resolve(), left = 0;

  function update() {
    const list = document.getElementById("correction_list");
    const texts = [...kept, ...items.map(({ words }) => words)];
    list.replaceChildren(...texts.map(text => Object.assign(document.createElement("li"), { textContent: text })));
    panel.hidden = !texts.length && !(served && note.textContent);
    undo.disabled = served && !kept.length;
    if (served) document.getElementById("to_save").textContent = texts.length ? "Corrected and saved" : "No corrections any more";
    list.scrollTop = list.scrollHeight;
    for (const listener of listeners) listener(items);
  }

  // One after the other; then the page is read anew, with what was measured, and until it is there nothing can be
  // pressed: a click on a page that goes would be lost.
  function tell(what, said) {
    left += 1;
    document.getElementById("to_save").textContent = "Corrections";
    note.textContent = "The plant is measured anew …";
    const sent = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(said) };
    turn = turn.then(() => fetch(what, sent)).then(
      () => {
        left -= 1;
        if (left) return;
        document.body.inert = true;
        location.reload();
      },
      () => { note.textContent = "There is no answer: cotton3dg view has ended. Start it again, and open its new address."; });
  }

  if (served) {
    [save.hidden, note.textContent] = [true, ""];
    fetch("corrections").then(answer => answer.json()).then(answer => {
      kept = answer.kept ?? [];
      if (!left) note.textContent = answer.message;
      update();
      // An empty list would stay in front of the page for a message that was read.
      setTimeout(() => { if (!left && !kept.length) { note.textContent = ""; update(); } }, READ_MS);
    });
  }

  undo.addEventListener("click", () => {
    if (served) return tell("undo", {});
    items.pop();
    update();
  });
  save.addEventListener("click", () => {
    const text = JSON.stringify({ corrections: items.map(({ saved }) => saved) }, null, 1) + "\n";
    const href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
    Object.assign(document.createElement("a"), { href, download: "corrections.json" }).click();
  });

  return {
    // words: for people; saved: as corrections.json has it; bolls: numbers that it is about; marks: places to draw.
    add(item) {
      items.push({ bolls: [], marks: [], ...item });
      update();
      if (served) tell("corrections", { corrections: [item.saved] });
    },
    onChange(listener) { listeners.push(listener); },
    // A length in words; its error is of its ends and of the scale.
    length(a, b, endErrors, relativeError) {
      const cm = Math.hypot(...a.map((x, n) => x - b[n]));
      const error = Math.hypot(...endErrors, cm * relativeError);
      return `ruler ${cm.toFixed(2)} ± ${error.toFixed(2)} cm`;
    },
  };
})();
