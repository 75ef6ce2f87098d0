// What every page has: its elements by name, a sentence over the page, and the word that writing takes.

export const element = (id) => document.getElementById(id);

/** A sentence over the page; a quiet one stands at its edge and goes by itself. */
export function say(text, quiet = false) {
  const status = element("status");
  status.textContent = text;
  status.classList.toggle("quiet", quiet);
  clearTimeout(say.timer);
  if (quiet) say.timer = setTimeout(() => (status.textContent = ""), 6000);
}

/** The word that writing takes, from the address that was printed. */
export const token = () => new URLSearchParams(location.search).get("token") ?? "";

/** Puts rows into a list; the control there that has the focus keeps it by its place. */
export function fill(list, rows) {
  const controls = () => [...list.querySelectorAll("button, input")];
  const at = controls().indexOf(document.activeElement);
  list.replaceChildren(...rows);
  if (at >= 0) controls()[Math.min(at, controls().length - 1)]?.focus();
}

/** A small button with a text and a name that is read out. */
export function control(text, name, act) {
  const button = Object.assign(document.createElement("button"), { type: "button", textContent: text, title: name });
  button.setAttribute("aria-label", name);
  button.addEventListener("click", act);
  return button;
}
