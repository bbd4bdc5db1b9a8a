/*
 * The two data scripts of a page, as the C++ side writes them. `viable-data` is JSON, every `<` written as \u003c.
 * `viable-binary` is base64 of a gzip stream of little-endian arrays. An array reference in the JSON is
 * {"at": byteOffset, "n": elements, "type": "f32"|"f64"|"u8"|"u16"|"u32"}, the offset a multiple of the element's size.
 */

const ELEMENT = { f32: Float32Array, f64: Float64Array, u8: Uint8Array, u16: Uint16Array, u32: Uint32Array };

/** An error whose message is meant for the reader of the report. */
export class DataError extends Error {}

/**
 * @typedef {{json: Object, array: (reference: Object, where: string, length?: number) => TypedArray}} Blocks the JSON,
 *   and the array that a reference names (`where` is for the message)
 */

/** Reads the data scripts. @returns {Promise<Blocks>} */
export async function readBlocks() {
  const json = readJson(takeText('viable-data'));
  return unpackBlocks({ ...json, binary: takeText('viable-binary') });
}

/** The same of data that came otherwise: the JSON with the text of the binary block in it. @returns {Promise<Blocks>} */
export async function unpackBlocks({ binary, ...json }) {
  const buffer = await unpack(binary);
  return { json, array: (reference, where, length = null) => arrayOf(buffer, reference, where, length) };
}

function arrayOf(buffer, reference, where, length) {
  const { at, n, type } = need(reference, where);
  const Type = ELEMENT[type];
  if (!Type) throw new DataError(`${where}: unknown element type ${type}.`);
  const size = Type.BYTES_PER_ELEMENT;
  const isWithin = [at, n].every((value) => Number.isInteger(value) && value >= 0) && at + n * size <= buffer.byteLength;
  if (!isWithin || at % size !== 0)
    throw new DataError(`${where}: ${n} values at byte ${at} are not within the ${buffer.byteLength} bytes of the data.`);
  if (length !== null && n !== length) throw new DataError(`${where}: ${n} values, expected ${length}.`);
  return new Type(buffer, at, n);
}

/** The text of a script, which is emptied: it is not needed twice. */
function takeText(id) {
  const script = document.getElementById(id);
  const text = script ? script.textContent.trim() : '';
  if (text === '' || text.startsWith('@@'))
    throw new DataError(`This page holds no data: its ${id} is empty. It is a template; the program writes the report.`);
  script.textContent = '';
  return text;
}

function readJson(text) {
  let json = null;
  try {
    json = JSON.parse(text);
  } catch (error) {
    throw new DataError(`The description (viable-data) is damaged: ${error.message}.`);
  }
  if (json?.format !== 1) throw new DataError(`The data has format ${json?.format}; this page reads format 1.`);
  return json;
}

/** base64 of a gzip stream to its bytes. */
async function unpack(text) {
  if (typeof DecompressionStream === 'undefined')
    throw new DataError(
      'This browser cannot unpack the data (it has no DecompressionStream). Any browser of 2023 or later can.',
    );
  try {
    const clean = text.replace(/\s+/g, '');
    const parts = [];
    for (let at = 0; at < clean.length; at += 1 << 20) {
      // a multiple of 4 characters
      const characters = atob(clean.slice(at, at + (1 << 20)));
      const bytes = new Uint8Array(characters.length);
      for (let i = 0; i < bytes.length; ++i) bytes[i] = characters.charCodeAt(i);
      parts.push(bytes);
    }
    const stream = new Blob(parts).stream().pipeThrough(new DecompressionStream('gzip'));
    return await new Response(stream).arrayBuffer();
  } catch (error) {
    throw new DataError(
      'The numbers (viable-binary) are damaged or cut off. ' +
        `Was the file copied whole? (${error.message || error.name})`,
    );
  }
}

export function need(value, where) {
  if (value === null || typeof value !== 'object') throw new DataError(`The data has no ${where}.`);
  return value;
}

export function needArray(value, where) {
  if (!Array.isArray(value)) throw new DataError(`The data has no list ${where}.`);
  return value;
}
