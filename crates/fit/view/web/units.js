// Lengths as text.

/** Meters of a unit, and its name. */
export const UNITS = [[1000, "km"], [1, "m"], [0.01, "cm"], [0.001, "mm"]];

/** A length in a fitting unit; `meters` are those of a unit of the scene, if they are known. */
export function lengthText(length, meters) {
  if (!meters) return `${Number(length.toPrecision(4))} units`;
  const [size, name] = UNITS.find(([size]) => length * meters >= 0.9999 * size) ?? UNITS.at(-1);
  return `${Number(((length * meters) / size).toPrecision(4))} ${name}`;
}

/** A positive number that was typed; null if it is none. */
export function positive(text) {
  const number = Number(text);
  return text.trim() !== "" && Number.isFinite(number) && number > 0 ? number : null;
}
