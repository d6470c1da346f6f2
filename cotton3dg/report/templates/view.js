"use strict";
// The plants of the folder as they are now: asked for every few seconds while somebody looks.
(() => {
  const EVERY_MS = 2000;
  const STAGES = {
    frames: "choosing images", sfm: "finding the cameras", train: "building the model", scale: "finding the scale",
    masks: "finding lint", segment: "lint in space", cluster: "separating bolls", traits: "measuring",
  };
  const body = document.getElementById("plants");
  const traits = body.dataset.traits.split(" ");
  const sureness = JSON.parse(body.dataset.sureness);
  const buttons = JSON.parse(body.dataset.buttons);
  const heads = [...body.parentElement.tHead.rows[0].cells].map(head => head.textContent.trim());
  const rows = new Map();
  const overview = document.getElementById("overview");
  const message = document.getElementById("message");
  const READ_MS = 15000;
  let shown;
  function say(text, kind = "") {
    [message.textContent, message.className] = [text, kind];
    clearTimeout(shown);
    if (kind !== "red") shown = setTimeout(() => { message.textContent = ""; }, READ_MS);  // it covers the last row
  }
  const path = (...parts) => parts.flatMap(part => part.split("/")).map(encodeURIComponent).join("/");
  const make = (name, properties = {}) => Object.assign(document.createElement(name), properties);

  async function ask(where, content, kind = "application/json") {
    const sent = content === undefined ? {} : { method: "POST", headers: { "Content-Type": kind }, body: content };
    const answer = await fetch(where, sent).catch(() => {
      throw new Error("There is no answer: cotton3dg view has ended. Start it again, and open its new address.");
    });
    const found = await answer.json();
    if (!answer.ok) throw new Error(found.message);
    return found;
  }

  // What a button does; what went wrong is said.
  const does = act => async event => {
    event.preventDefault();
    try {
      say("");
      await act(event.currentTarget);
      await look();
    } catch (error) {
      say(error.message, "red");
    }
  };

  // ------------------------------------------------------------ the rows
  function rowOf(plant) {
    if (rows.has(plant)) return rows.get(plant);
    const row = make("tr");
    row.append(make("th", { scope: "row" }), ...Array.from({ length: traits.length + 3 }, () => make("td")));
    for (const [n, cell] of [...row.cells].entries()) if (n > 1) cell.dataset.label = heads[n];
    row.cells[1].className = "remarks";
    row.cells[2 + traits.length].className = "film";
    for (const cell of [...row.cells].slice(2, 2 + traits.length)) cell.className = "n";
    const tools = make("div", { className: "tools" });
    row.lastChild.append(tools);
    for (const [job, words] of Object.entries({ ...buttons, stop: "Stop" })) {
      const button = make("button", { type: "button", textContent: words });
      button.dataset.job = job;
      button.addEventListener("click", does(() => ask(path(plant, job), chosen())));
      tools.append(button);
    }
    rows.set(plant, row);
    return row;
  }

  // What the form says of measuring; a blank leaves what the plant has.
  const settings = ["preset", "table_length_cm", "table_width_cm"].map(id => document.getElementById(id));
  const chosen = () => JSON.stringify(Object.fromEntries(settings.map(({ id, value }) => [id, value.trim()])));

  // A trait with how sure it is and its interval.
  function trait(found, name) {
    if (!found.traits[name]) return ["–"];
    const sure = found.sure[name];
    const mark = sure && make("span", { className: `sure ${sure}`, title: sureness[sure], role: "img", ariaLabel: sureness[sure] });
    const interval = found.intervals[name] && make("span", { className: "soft", textContent: found.intervals[name] });
    return [mark, found.traits[name], interval && make("br"), interval].filter(Boolean);
  }

  const link = (plant, page, words) => make("a", { href: path(plant, page), textContent: words });

  function fill(found) {
    const row = rowOf(found.plant);
    const has = page => found.pages.includes(page);
    row.cells[0].replaceChildren(has("report.html") ? link(found.plant, "report.html", found.shown) : found.shown);
    const busy = found.busy || found.state === "working";
    const stopped = found.job.startsWith("stopped");
    const last = stopped || found.job.includes(found.text) ? found.job : [found.text, found.job].filter(Boolean).join("; ");
    // How far a job of this page is, it says itself; of other runs only the log is there.
    const logged = found.state === "working" ? found.text : "at work";
    const told = found.job || (found.busy ? logged.replace(/, stage \d+ of \d+/, "") : logged);
    const now = told.replace(/^\w+/, stage => STAGES[stage] ?? stage);
    const words = busy ? `working: ${now}` : `${found.state}: ${last}`;
    const made = !busy && found.made_with && make("span", { className: "soft", textContent: found.made_with });
    row.cells[1].replaceChildren(make("span", { className: found.verdict, textContent: words }), ...(made ? [make("br"), made] : []));
    traits.forEach((name, n) => row.cells[2 + n].replaceChildren(...trait(found, name)));
    if (found.check && has("check/check.html")) {
      const film = make("span", { className: found.check.verdict });
      // A first count beside the true one would only confuse.
      film.append(link(found.plant, "check/check.html", found.check.verdict), found.state === "done" && found.check.verdict === "green" ? "" : ` ${found.check.text}`);
      row.cells[2 + traits.length].replaceChildren(film);
    }
    for (const button of row.lastChild.querySelectorAll("button")) {
      if (button.dataset.job === "stop") button.hidden = !found.busy;
      else button.disabled = busy;
    }
    const tools = row.lastChild.firstChild;
    if (has("traits/traits.csv") && !tools.querySelector("a")) {
      if (has("report.html")) tools.append(link(found.plant, "report.html", "Report"));
      tools.append(link(found.plant, "traits/traits.csv", "Row (CSV)"), link(found.plant, "traits/bolls.csv", "Bolls (CSV)"));
    }
    return row;
  }

  async function look() {
    const { plants, pages } = await ask("state");
    const shown = plants.map(fill);
    if (shown.some((row, n) => body.rows[n] !== row) || body.rows.length !== shown.length) body.replaceChildren(...shown);
    document.getElementById("none").hidden = shown.length > 0;
    if (overview) overview.hidden = !pages.includes("index.html");
  }

  async function follow() {
    if (!document.hidden) await look().catch(error => say(error.message, "red"));
    setTimeout(follow, EVERY_MS);
  }

  // ------------------------------------------------------------ films and tables
  const form = document.getElementById("add");
  const [film, plant] = [document.getElementById("film"), document.getElementById("plant")];
  form?.addEventListener("submit", does(async () => {
    const kinds = film.accept.split(",");
    if (!kinds.some(kind => film.files[0].name.toLowerCase().endsWith(kind))) throw new Error(`A film ends in ${kinds.join(", ")}.`);
    const name = plant.value.trim();
    if (/[/\\]/.test(name)) throw new Error("Name the plant without / and \\.");
    say("The film is copied …");
    const { plant: folder } = await ask(path(name, film.files[0].name), film.files[0], "application/octet-stream");
    form.reset();
    say(`${name} is there${folder === name ? "" : `, in the folder ${folder}`}. Check its film, or measure it.`);
  }));
  for (const name of ["dragover", "drop"]) {
    document.addEventListener(name, event => {
      event.preventDefault();
      if (!form || !event.dataTransfer.files.length) return;
      film.files = event.dataTransfer.files;
      plant.focus();
    });
  }
  for (const button of document.querySelectorAll("[data-saves]")) {
    button.addEventListener("click", does(async ({ dataset: { saves } }) => {
      await ask("tables", "{}");
      const answer = await fetch(saves);
      if (!answer.ok) throw new Error((await answer.json()).message);
      location.assign(saves);
      const name = decodeURIComponent(answer.headers.get("Content-Disposition").split("''")[1]);
      say(`${name} is in your downloads.`);
    }));
  }

  follow();
})();
