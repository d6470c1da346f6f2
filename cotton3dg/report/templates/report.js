"use strict";
// What the page's parts share: the boll that is chosen, and what a person says of it.
const picking = (() => {
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

  // ------------------------------------------------------------ paper has no folds
  window.addEventListener("beforeprint", () => { for (const fold of document.querySelectorAll("details")) fold.open = true; });

  // ------------------------------------------------------------ choosing a boll
  const rows = new Map([...document.querySelectorAll("tr[data-boll]")].map(row => [row.dataset.boll, row]));
  const panel = document.getElementById("chosen");
  const listeners = [];
  let merging;

  function choose(id) {
    const [first, row] = [merging, rows.get(id)];
    merging = undefined;
    if (first && first !== id && row) mend("merge", [first, id]);
    for (const [other, own] of rows) {
      own.classList.toggle("chosen", other === id);
      const merge = own.querySelector("[data-mend=merge]");
      [merge.disabled, merge.textContent] = [other === id, !row || other === id ? "merge" : `with ${id}`];
      own.querySelector("button").setAttribute("aria-pressed", String(other === id));
    }
    if (row && panel) describe(row, id);
    for (const listener of listeners) listener(id);
  }

  function picturesOf(ids) {
    const pictures = document.createElement("div");
    pictures.className = "big";
    for (const id of ids) pictures.append(...[...rows.get(id).querySelectorAll(".cuts img")].map(image => image.cloneNode()));
    return pictures;
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
    doubts.textContent = row.querySelector(".doubts").textContent;
    panel.replaceChildren(heading, list, doubts, menders(row, id), picturesOf([id]));
  }

  // The buttons of the boll's row, here too; merge asks for the other boll.
  function menders(row, id) {
    const tools = document.createElement("div");
    tools.className = "tools";
    for (const button of row.querySelectorAll("[data-mend]")) {
      const own = button.cloneNode(true);
      own.disabled = false;
      own.addEventListener("click", () => {
        if (own.dataset.mend !== "merge") return mend(own.dataset.mend, [id]);
        merging = id;
        const hint = document.createElement("p");
        hint.textContent = `Now choose the boll that is one with boll ${id}.`;
        tools.after(hint);
      });
      tools.append(own);
    }
    return tools;
  }

  function chooseBranch(line) {
    const heading = document.createElement("h3");
    heading.textContent = line.name;
    const words = document.createElement("p");
    words.textContent = line.text;
    const own = line.bolls.map(String).filter(id => rows.has(id));
    for (const [id, row] of rows) row.classList.toggle("chosen", own.includes(id));
    panel?.replaceChildren(heading, words, picturesOf(own));
  }

  for (const [id, row] of rows) row.addEventListener("click", () => choose(id));

  // ------------------------------------------------------------ mending bolls
  function place(id) {
    const centre = rows.get(id).dataset.centre;
    return { boll_id: Number(id), ...(centre ? { centre_cm: JSON.parse(centre) } : {}) };
  }

  function mend(kind, bolls) {
    corrections.add({ words: `${kind} ${bolls.join(" + ")}`, saved: { kind, bolls: bolls.map(place) }, bolls });
  }

  corrections.onChange(items => {
    const mended = new Set(items.flatMap(item => item.bolls));
    for (const [id, row] of rows) row.classList.toggle("mended", mended.has(id));
  });
  for (const button of document.querySelectorAll("[data-mend]")) {
    button.addEventListener("click", event => {
      event.stopPropagation();
      const [kind, id] = [button.dataset.mend, button.closest("tr").dataset.boll];
      const chosen = document.querySelector("tr.chosen")?.dataset.boll;
      if (kind !== "merge") mend(kind, [id]);
      else if (!chosen || chosen === id) choose(id);
      else mend(kind, [chosen, id]);
    });
  }

  return {
    choose, chooseBranch,
    onChoose(listener) { listeners.push(listener); },
    // Show the row of a boll that is pointed at, or of none.
    touch(id) { for (const [other, row] of rows) row.classList.toggle("touched", other === id); },
    // A boll in a line.
    tell(id) {
      const cell = column => rows.get(id)?.cells[column].textContent ?? "–";
      return `Boll ${id}: ${cell(1)} cm³, height ${cell(3)} cm`;
    },
  };
})();
