/** The two ways in which a file is refused. */

/** Bytes break a rule of the spec; `rule` is its id in spec/blockfile.md, section 15. */
export class CorruptFileError extends Error {
  /**
   * @param {string} rule such as "GSB-0301"
   * @param {number} at byte of the file
   * @param {string} said
   */
  constructor(rule, at, said) {
    super(`${said}, at byte ${at} [${rule}]`);
    this.name = 'CorruptFileError';
    this.rule = rule;
    this.at = at;
  }
}

/** The file, or the column that was asked for, needs a newer reader or is not there. */
export class UnsupportedError extends Error {
  /** @param {string} said */
  constructor(said) {
    super(said);
    this.name = 'UnsupportedError';
  }
}
