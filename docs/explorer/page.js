// The envelope explorer: numbers in, three envelopes out; its state is the page's address.
"use strict";

(() => {
  const root = document.getElementById("explorer");
  if (!root) return;
  const FIELDS = { R: [1e-3, "mΩ"], L: [1e-6, "µH"], flux: [1e-3, "mWb"], kv: [1, "rpm/V"], pairs: [1, ""], gear: [1, ""], bus: [1, "V"], current: [1, "A"], speed: [1, "rad/s"] };
  const MODELS = [["refined", "refined", "var(--md-accent-fg-color)", 2.5, ""], ["simplified-dc", "v_d = 0", "#d9480f", 1.8, "7 4"], ["square", "square", "#8a94a3", 1.6, "2 4"]];
  const input = (name) => root.querySelector(`[name=${name}]`);
  const value = (name) => Number(input(name).value);
  const text = (number, digits = 3) => Number.isFinite(number) ? Number(number.toPrecision(digits)).toString() : "no limit";

  function motor() {
    return { resistance: value("R") * 1e-3, inductance: value("L") * 1e-6, flux: value("flux") * 1e-3,
      polePairs: value("pairs"), peakCurrent: value("current") };
  }

  function show(values) {
    for (const [name, number] of Object.entries(values)) if (input(name)) input(name).value = number;
  }

  function fromLibrary(entry) {
    show({ R: text(entry.resistance * 1e3, 5), L: text(entry.inductance * 1e6, 5), flux: text(entry.flux * 1e3, 5),
      pairs: entry.polePairs, gear: entry.gear, bus: entry.bus, current: text(entry.peakCurrent, 5) });
    keepKv();
    const one = motor(), corner = motorLaw.criticalSpeed(one, one.peakCurrent, entry.bus, "refined");
    show({ speed: text((corner + motorLaw.noLoadSpeed(one, entry.bus)) / 2 / entry.gear, 3) }); // where the d-axis costs
  }

  function step(reach) { // round distance of about four marks on an axis
    const power = 10 ** Math.floor(Math.log10(reach / 3));
    return [5, 2, 1].map((one) => one * power).find((one) => one <= reach / 3);
  }

  function marks(reach) { // on both sides of zero, zero left out
    const by = step(reach);
    return Array.from({ length: Math.floor(reach / by) }, (_, index) => (index + 1) * by).flatMap((one) => [one, -one]);
  }

  function keepKv() { input("kv").value = text(60 / (2 * Math.PI * Math.sqrt(3) * value("pairs") * value("flux") * 1e-3), 5); }

  function curve(one, gear, bus, model, top, side) { // without speeds at which no current fits the voltage
    return Array.from({ length: 481 }, (_, index) => top * (index / 240 - 1))
      .map((speed) => [speed, motorLaw.limits(one, speed * gear, bus, model)])
      .filter(([, [lower, upper]]) => upper > lower)
      .map(([speed, limits]) => [speed, gear * limits[side]]);
  }

  function draw() {
    const one = motor(), gear = value("gear"), bus = value("bus");
    const given = [one.resistance, one.flux, one.polePairs, one.peakCurrent, gear, bus];
    const bad = given.some((number) => !(number > 0)) || !(one.inductance >= 0);
    root.querySelector(".problem").hidden = !bad;
    if (bad) return;
    const noLoad = motorLaw.noLoadSpeed(one, bus) / gear, top = 1.15 * noLoad;
    const peak = gear * motorLaw.torqueConstant(one) * one.peakCurrent;
    const x = (speed) => 320 + 300 * speed / top, y = (torque) => 180 - 160 * torque / (1.12 * peak);
    const path = (points) => "M" + points.map(([a, b]) => `${x(a).toFixed(1)},${y(b).toFixed(1)}`).join("L");
    const parts = [`<path d="M20,180H620M320,20V340" class="axis"/>`];
    const refined = [curve(one, gear, bus, "refined", top, 1), curve(one, gear, bus, "refined", top, 0)];
    parts.push(`<path d="${path([...refined[0], ...refined[1].reverse()])}Z" class="inside"/>`);
    for (const [model, , color, width, dash] of MODELS)
      for (const side of [0, 1])
        parts.push(`<path d="${path(curve(one, gear, bus, model, top, side))}" fill="none" stroke="${color}" stroke-width="${width}" stroke-dasharray="${dash}"/>`);
    const speed = Math.min(value("speed"), top);
    parts.push(`<path d="M${x(speed)},20V340" class="chosen"/>`);
    for (const mark of marks(top)) parts.push(`<path d="M${x(mark)},177v6" class="axis"/><text x="${x(mark)}" y="197" text-anchor="middle">${text(mark)}</text>`);
    for (const mark of marks(1.05 * peak)) parts.push(`<path d="M317,${y(mark)}h6" class="axis"/><text x="312" y="${y(mark) + 4}" text-anchor="end">${text(mark)}</text>`);
    parts.push('<text x="326" y="16">N m</text><text x="620" y="172" text-anchor="end">rad/s</text>');
    root.querySelector("svg").innerHTML = parts.join("");
    const [without, given_] = ["simplified-dc", "refined"].map((model) => gear * motorLaw.limits(one, speed * gear, bus, model)[1]);
    const lost = without > 0 ? `${text(100 * (1 - Math.max(given_, 0) / without), 3)} %` : "nothing is left to lose";
    const rows = [["peak torque on the joint", `${text(peak)} N m`], ["no-load speed of the joint", `${text(noLoad)} rad/s`],
      ...["refined", "simplified-dc"].map((model) => [`whole peak torque up to (${model === "refined" ? "refined" : "v_d = 0"})`,
        `${text(motorLaw.criticalSpeed(one, one.peakCurrent, bus, model) / gear)} rad/s`]),
      [`at ${text(speed)} rad/s: refined, v_d = 0`, `${text(given_)}, ${text(without)} N m`], ["the d-axis costs there", lost]];
    root.querySelector("tbody").innerHTML = rows.map(([name, shown]) => `<tr><td>${name}</td><td>${shown}</td></tr>`).join("");
    const state = Object.keys(FIELDS).filter((name) => name !== "kv").map((name) => `${name}=${input(name).value}`).join("&");
    history.replaceState(null, "", `#${state}`);
  }

  const choice = input("library");
  for (const entry of motorLibrary) choice.add(new Option(entry.title, entry.name));
  choice.addEventListener("change", () => {
    const entry = motorLibrary.find(({ name }) => name === choice.value);
    if (entry) { fromLibrary(entry); draw(); }
  });
  root.addEventListener("input", (event) => {
    if (event.target.name === "library") return;
    if (event.target.name === "kv") input("flux").value = text(1e3 * motorLaw.fluxOfKv(value("kv"), value("pairs")), 5);
    else keepKv();
    draw();
  });
  root.querySelector("button").addEventListener("click", (event) => {
    navigator.clipboard?.writeText(location.href);
    event.target.textContent = "the address of this page holds it";
  });
  const shared = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  fromLibrary(motorLibrary[0]);
  show(Object.fromEntries(Object.entries(shared).filter(([name, number]) => name in FIELDS && number !== "" && Number.isFinite(Number(number)))));
  keepKv();
  draw();
  window.explorer = { motor, draw, fromLibrary };
})();
