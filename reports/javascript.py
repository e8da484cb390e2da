"""CasADi functions as JavaScript: a law is written once, and a page simulates with the very same expressions."""

from typing import Any

_UNARY = {
    "ASSIGN": "{0}", "NEG": "-{0}", "EXP": "Math.exp({0})", "LOG": "Math.log({0})", "SQRT": "Math.sqrt({0})",
    "SQ": "{0}*{0}", "TWICE": "2*{0}", "SIN": "Math.sin({0})", "COS": "Math.cos({0})", "TAN": "Math.tan({0})",
    "TANH": "Math.tanh({0})", "FABS": "Math.abs({0})", "SIGN": "Math.sign({0})", "FLOOR": "Math.floor({0})",
    "INV": "1/{0}", "NOT": "+!{0}",
}  # fmt: skip
_BINARY = {
    "ADD": "{0}+{1}", "SUB": "{0}-{1}", "MUL": "{0}*{1}", "DIV": "{0}/{1}", "POW": "Math.pow({0},{1})",
    "CONSTPOW": "Math.pow({0},{1})", "FMIN": "Math.min({0},{1})", "FMAX": "Math.max({0},{1})", "LT": "+({0}<{1})",
    "LE": "+({0}<={1})", "EQ": "+({0}==={1})", "NE": "+({0}!=={1})", "AND": "+({0}&&{1})", "OR": "+({0}||{1})",
    "IF_ELSE_ZERO": "({0}?{1}:0)", "ATAN2": "Math.atan2({0},{1})", "COPYSIGN": "(({1}<0?-1:1)*Math.abs({0}))",
}  # fmt: skip


def javascript(function: Any, name: str) -> str:
    """Return a CasADi function of scalars as the text of a JavaScript function.

    It takes one array for each input and returns the entries of all outputs in one array, column by column.

    Args:
        function: An SX function with dense inputs.

    Raises:
        NotImplementedError: It uses an operation that is not known here.
    """
    import casadi

    ca: Any = casadi
    known = {getattr(ca, f"OP_{op}"): text for table in (_UNARY, _BINARY) for op, text in table.items()}
    lines: list[str] = []
    offsets = [0]
    for index in range(function.n_out()):
        offsets.append(offsets[-1] + function.numel_out(index))
    # Index of each structural nonzero of an output in its dense form, column by column.
    places = [list(map(int, function.sparsity_out(index).find())) for index in range(function.n_out())]
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        into, read = function.instruction_output(k), function.instruction_input(k)
        match code:
            case ca.OP_CONST:
                lines.append(f"w{into[0]}={_number(function.instruction_constant(k))};")
            case ca.OP_INPUT:
                lines.append(f"w{into[0]}=a{read[0]}[{read[1]}];")
            case ca.OP_OUTPUT:
                lines.append(f"o[{offsets[into[0]] + places[into[0]][into[1]]}]=w{read[0]};")
            case _ if code in known:
                lines.append(f"w{into[0]}={known[code].format(*(f'w{i}' for i in read))};")
            case _:
                raise NotImplementedError(f"CasADi operation {code} has no JavaScript")
    arguments = ",".join(f"a{i}" for i in range(function.n_in()))
    work = ",".join(f"w{i}" for i in range(function.sz_w()))
    return (
        f"function {name}({arguments}){{let {work};const o=new Float64Array({offsets[-1]});"
        f"{''.join(lines)}return o}}\n"
    )


def _number(value: float) -> str:
    return repr(value).replace("inf", "Infinity").replace("nan", "NaN")
