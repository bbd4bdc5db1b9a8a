#!/usr/bin/env python3
"""Sentences of the pages and of the comments in public headers: how long they are, and how they begin.

Fails where a sentence of a page (*.md) or of a public header (framework/include) has more than 25 words, and where a
sentence of a public header begins with a word of FORBIDDEN. Before that it plants such sentences and must find them.
Usage: words.py [SOURCE_DIR] [--averages]    (--averages: also the words per sentence of each file)

A sentence ends with a full stop, question mark or exclamation mark before a space and a word that does not begin with a
small letter. It also ends with its paragraph, item of a list, cell of a table, heading or comment. Semicolons and
colons end none. A word is what stands between spaces and has a letter or a digit. A code span is one word; the address
of a link, an image and "@param" are none. Blocks of code (fenced, or indented by four columns) are no prose. There are
no exceptions for files: a formula that makes a sentence long belongs into a code span or a block.
"""
import re
import sys
from pathlib import Path

LONGEST = 25
FORBIDDEN = ("of", "what", "its", "those", "where", "who")
NOT_PAGES = {"build", "runs", "node_modules", ".git"}

ABBREVIATIONS = "".join(rf"(?<!\b{word})" for word in ("e\\.g", "i\\.e", "[Ee]q", "[Ee]qs", "[Ff]ig", "[Ff]igs", "vs", "al"))
SENTENCE_END = re.compile(ABBREVIATIONS + r"[.!?][\"')*_\]]*(?=\s+[^\sa-z])")
ITEM = re.compile(r"^\s*(?:[-*+]|\d+\.)\s+")
COMMENT = re.compile(r'"(?:\\.|[^"\\\n])*"|(?P<line>//[^\n]*)|(?P<block>/\*.*?\*/)', re.DOTALL)


def split_sentences(lines):
    """(line number, sentence, its place) for a block, which is a list of (line number, text)."""
    text, starts = "", []
    for number, line in lines:
        starts.append((len(text), number))
        text += line.strip() + "\n"
    # A code span keeps its length and becomes one word.
    text = re.sub(r"(`+)(.+?)\1", lambda m: re.sub(r"[^`]", "x", m[0]), text, flags=re.DOTALL)
    begin = 0
    ends = [m.end() for m in SENTENCE_END.finditer(text)] + [len(text)]
    for end in ends:
        sentence = text[begin:end]
        first = begin + len(sentence) - len(sentence.lstrip())
        if sentence.strip():
            yield max(n for start, n in starts if start <= first), sentence.strip(), (first, end)
        begin = end


def count_words(sentence):
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", " ", sentence)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    return sum(1 for token in text.split() if re.search(r"\w", token) and not token.startswith("@"))


def find_page_blocks(text):
    """Paragraphs, items, cells and headings of a page, each a list of (line number, text)."""
    text = re.sub(r"<!--.*?-->", lambda m: re.sub(r"[^\n]", " ", m[0]), text, flags=re.DOTALL)
    block, fence, after_blank, in_list = [], None, True, False
    for number, line in enumerate(text.splitlines(), 1):
        mark = re.match(r"\s*(```+|~~~+)", line)
        if fence or mark:
            if block:
                yield block
                block = []
            fence = None if fence and mark and mark[1].startswith(fence) else fence or mark[1]
            continue
        blank = not line.strip()
        code = line.startswith("    ") and not in_list and not block
        cells = line.strip().startswith("|")
        starts = ITEM.match(line) or line.startswith("#") or cells or blank or code
        if starts and block:
            yield block
            block = []
        in_list = bool(ITEM.match(line)) or (in_list and (blank or line.startswith(" ") or not after_blank))
        after_blank = blank
        if cells:
            for cell in re.split(r"(?<!\\)\|", line.strip().strip("|")):
                yield [(number, re.sub(r"^[\s:\-]+$", "", cell))]
        elif line.startswith("#"):
            yield [(number, line.lstrip("#"))]
        elif not blank and not code:
            block.append((number, ITEM.sub("", line)))
    if block:
        yield block


def find_comments(text):
    """Comments of a header, each a list of (line number, text); line comments below each other are one."""
    comment, last = [], -1
    for match in COMMENT.finditer(text):
        number = text.count("\n", 0, match.start()) + 1
        alone = not text[text.rfind("\n", 0, match.start()) + 1:match.start()].strip()
        if match["line"]:
            if comment and not (alone and number == last + 1):
                yield comment
                comment = []
            indent = match.start() - text.rfind("\n", 0, match.start()) - 1
            words = re.sub(r"^//[/!]?<?", lambda m: " " * len(m[0]), match["line"])
            comment.append((number, " " * indent + words))
            last = number
        elif match["block"]:
            if comment:
                yield comment
                comment = []
            indent = match.start() - text.rfind("\n", 0, match.start()) - 1
            lines = re.sub(r"^/\*[*!]?<?|\*/$", "", match["block"]).splitlines()
            yield [(number + i, (" " * indent if i == 0 else "") + line) for i, line in enumerate(lines)]
    if comment:
        yield comment


def find_header_blocks(text):
    for comment in find_comments(text):
        full = [line for _, line in comment[1:] if line.strip()] or [comment[0][1]]
        indent = min(len(line) - len(line.lstrip()) for line in full)
        block, hangs = [], False
        for index, (number, line) in enumerate(comment):
            is_parameter = line.strip().startswith("@")
            hangs = is_parameter or bool(ITEM.match(line)) or (hangs and bool(block))  # its text may stand farther right
            deep = index > 0 and len(line) - len(line.lstrip()) >= indent + 4 and not hangs
            table = not hangs and re.search(r"\S {3,}\S", line.strip())
            if (not line.strip() or deep or table or is_parameter or ITEM.match(line)) and block:
                yield block
                block = []
            if table and not deep:
                yield from ([(number, cell)] for cell in re.split(r" {3,}", line.strip()))
            elif line.strip() and not deep:
                block.append((number, ITEM.sub("", line)))
        if block:
            yield block


def find_problems(text, is_header):
    """(line number, problem) of a file, and its numbers of sentences and of words."""
    problems, sentences, words = [], 0, 0
    for block in find_header_blocks(text) if is_header else find_page_blocks(text):
        flat = "".join(line.strip() + "\n" for _, line in block)
        for number, sentence, (begin, end) in split_sentences(block):
            shown = " ".join(flat[begin:end].split())
            count = count_words(sentence)
            if count:
                sentences, words = sentences + 1, words + count
            if count > LONGEST:
                problems.append((number, f"a sentence of {count} words, {LONGEST} is the most: \"{shown}\"; say it in two "
                                         "or more, each with its subject first"))
            first = re.match(r"[^\w`]*(\w+)", sentence)
            if is_header and first and first[1].lower() in FORBIDDEN:
                problems.append((number, f"a sentence that begins with \"{first[1]}\": \"{shown}\"; begin with the noun that "
                                         "it is about"))
    return problems, sentences, words


def check_itself():
    """Plants sentences that are too long, and such as just are not, in every form that prose has."""
    pages = ["{}.", "First. {}. Last.", "Text:\n\n- item\n- {}.\n", "1. {}\n2. item", "| a | {} |\n|---|---|", "# {}",
             "> {}", "```\ncode\n```\n{}", "- item\n\n    {}", "**Bold.** {}! More", "({}.) Next.", "{}\n\nNext"]
    headers = ["/** {}. */", "int a;  ///< {}\nint b;  ///< next", "// {}", "/** First. {}.\n*/", "/* {}\n\nNext */",
               "/** - item\n- {} */", "/** a   {}   b */", 'f("//");  // {}', "/** a\n\n{}\n\n    code = 1\n*/",
               "/** a\n@param {}\n*/", "/** a\n@return\n        {}\n*/"]
    words = ["word", "`a span of code`", "[word](to/a/page.md)", "word\n", "word;", "word:", "no. ", "(word)", "1.5"]
    for form, is_header in [(form, False) for form in pages] + [(form, True) for form in headers]:
        for word in words:
            if "\n" in word and any(mark in form for mark in ("|", "//", "#", "a   ")):
                continue
            for count in (LONGEST, LONGEST + 1):
                text = form.format(" ".join(["One"] + [word] * (count - 2) + ["end"]))
                found = find_problems(text, is_header)[0]
                if len(found) != (count > LONGEST):
                    yield f"words.py: planted {text!r}: found {found}"
    for word in FORBIDDEN:
        for first in (word, word.capitalize()):
            for form in ("/** {} it is. */", "int a;  ///< {} it", "// {} it is.", "/** First\n\n{} it is. */"):
                if len(found := find_problems(form.format(first), True)[0]) != 1:
                    yield f"words.py: planted {form.format(first)!r}: found {found}"
        if len(found := find_problems(f"// First. {word.capitalize()} it is.", True)[0]) != 1:
            yield f"words.py: planted {word} as second sentence: found {found}"
    if found := find_problems("/** The limit of what is known, and its unit. */", True)[0]:
        yield f"words.py: found in good prose {found}"


def main():
    arguments = [argument for argument in sys.argv[1:] if argument != "--averages"]
    root = Path(arguments[0] if arguments else ".").resolve()
    problems = list(check_itself())
    files = [page for page in root.rglob("*.md") if not NOT_PAGES & set(page.relative_to(root).parts)]
    files += (root / "framework/include").rglob("*.h")
    for path in sorted(files):
        found, sentences, words = find_problems(path.read_text(encoding="utf-8"), path.suffix == ".h")
        problems += [f"{path.relative_to(root)}:{number}: {problem}" for number, problem in found]
        if "--averages" in sys.argv:
            print(f"{words / max(sentences, 1):5.1f} words a sentence, {sentences:4} sentences: {path.relative_to(root)}")
    for problem in problems:
        print(problem, file=sys.stderr)
    print(f"{len(files)} files, {len(problems)} problems")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
