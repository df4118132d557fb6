"""What help says above the flags."""

from __future__ import annotations

from pseudolidar.running.settings_docs import class_doc, doc_parts


def verb_description(cls: type, module_doc: str) -> str:
    """What help says above the flags: what the verb does, and examples."""
    own, module = class_doc(cls), doc_parts(module_doc)
    paragraphs = [own.body or module.body]
    if examples := own.examples or module.examples:
        paragraphs.append("Examples:\n" + "\n".join(f"  {line}" for line in examples))
    return "\n\n".join(filter(None, paragraphs))
