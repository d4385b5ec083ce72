#!/usr/bin/env python3
"""Writes rosbags_golden.jsonl: messages as PyPI's rosbags encodes them, with their type hashes.

rosbags (0.11.9) has definitions, an encoder and a hash of its own. Definitions that it lacks are read
from ../definitions and definitions/ with its parser; the messages that ROS derives from services and
actions are written down here a second time.

    pip install rosbags==0.11.9
    python3 rosbags_golden.py            writes the file
    python3 rosbags_golden.py --check    fails if the file differs from what would be written
"""

import json
import sys
from pathlib import Path

import numpy
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore, store as rosbags_store

HERE = Path(__file__).parent
GOLDEN = HERE / 'rosbags_golden.jsonl'
BUILT_IN = HERE.parent / 'definitions'
TESTED = HERE / 'definitions'
DUMMY = ('structure_needs_at_least_one_member', (Nodetype.BASE, ('uint8', 0)))

# ROS defines `char` as `uint8`, and hashes it so; rosbags 0.11.9 hashes it as a type of its own.
rosbags_store.TIDMAP['char'] = rosbags_store.TIDMAP['uint8']


def nested(name):
    return (Nodetype.NAME, name)


def parsed_fields(package, text):
    """Returns the fields of the text of a definition."""
    (_, fields), = get_types_from_msg(text, f'{package}/msg/Parsed').values()
    return fields or [DUMMY]


def service(base, request, response):
    """Returns the messages of a service, and the services, which have hashes only."""
    event = [
        ('info', nested('service_msgs/msg/ServiceEventInfo')),
        ('request', (Nodetype.SEQUENCE, (nested(f'{base}_Request'), 1))),
        ('response', (Nodetype.SEQUENCE, (nested(f'{base}_Response'), 1))),
    ]
    members = [(f'{it.lower()}_message', nested(f'{base}_{it}')) for it in ('Request', 'Response', 'Event')]
    messages = {f'{base}_Request': request, f'{base}_Response': response, f'{base}_Event': event}
    return messages, {base: members}


def action(base, goal, result, feedback):
    """Returns the messages of an action, and the action with its services, which have hashes only."""
    goal_id = ('goal_id', nested('unique_identifier_msgs/msg/UUID'))
    messages = {
        f'{base}_Goal': goal,
        f'{base}_Result': result,
        f'{base}_Feedback': feedback,
        f'{base}_FeedbackMessage': [goal_id, ('feedback', nested(f'{base}_Feedback'))],
    }
    sent, send = service(
        f'{base}_SendGoal',
        [goal_id, ('goal', nested(f'{base}_Goal'))],
        [('accepted', (Nodetype.BASE, ('bool', 0))), ('stamp', nested('builtin_interfaces/msg/Time'))],
    )
    got, get = service(
        f'{base}_GetResult',
        [goal_id],
        [('status', (Nodetype.BASE, ('int8', 0))), ('result', nested(f'{base}_Result'))],
    )
    members = [
        ('goal', nested(f'{base}_Goal')),
        ('result', nested(f'{base}_Result')),
        ('feedback', nested(f'{base}_Feedback')),
        ('send_goal_service', nested(f'{base}_SendGoal')),
        ('get_result_service', nested(f'{base}_GetResult')),
        ('feedback_message', nested(f'{base}_FeedbackMessage')),
    ]
    return messages | sent | got, send | get | {base: members}


def definitions(types):
    """Adds all definitions that rosbags lacks. Returns the names of messages and of other types."""
    messages, others = set(), {}
    for path in sorted([*BUILT_IN.glob('*/*/*'), *TESTED.glob('*/*/*')]):
        package, kind, name = path.parts[-3], path.parts[-2], path.stem
        base = f'{package}/{kind}/{name}'
        if base in types.fielddefs:
            messages.add(base)
            continue
        parts = [parsed_fields(package, part) for part in path.read_text().split('---\n')]
        if kind == 'msg':
            found, hashed = {base: parts[0]}, {}
        else:
            found, hashed = (service if kind == 'srv' else action)(base, *parts)
        types.register({name: ([], fields) for name, fields in found.items()})
        messages |= found.keys()
        others |= hashed
    # They are no messages, so they are known to the hash only.
    types.fielddefs.update({name: ([], fields) for name, fields in others.items()})
    return messages, others.keys()


class Values:
    """Draws values that differ from each other, and that both sides write in the same way."""

    def __init__(self, types, is_small):
        self.types, self.is_small, self.drawn = types, is_small, 0

    def base(self, name, bound):
        self.drawn += 1
        n = self.drawn
        if name == 'bool':
            return not self.is_small and n % 2 == 1
        if name == 'string':
            text = '' if self.is_small else f'tür {n}'
            return text.encode()[:bound or None].decode(errors='ignore')
        if name.startswith('float'):
            special = [float('nan'), float('inf'), float('-inf'), -0.0]
            return special[n % 4] if self.is_small else n * 1.25 - 20
        # rosbags takes `byte` for a signed number.
        bits = 7 if name == 'byte' else 8 if name == 'char' else int(name.lstrip('uint'))
        top = 2 ** (bits - (not name.startswith('u') and name not in ('byte', 'char')))
        least = -top if name.startswith('int') else 0
        return (least if n % 2 else top - 1) if self.is_small else min(n, top - 1)

    def element(self, desc):
        """Returns a value as JSON and as rosbags takes it."""
        kind, of = desc
        if kind == Nodetype.BASE:
            value = self.base(*of)
            return value, value
        return self.message(of)

    def field(self, desc):
        kind, of = desc
        if kind in (Nodetype.BASE, Nodetype.NAME):
            return self.element(desc)
        element, size = of
        length = size if kind == Nodetype.ARRAY else 0 if self.is_small else min(size or 3, 3)
        pairs = [self.element(element) for _ in range(length)]
        values, objects = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
        if element[0] == Nodetype.BASE and element[1][0] != 'string':
            name = {'byte': 'uint8', 'char': 'uint8'}.get(element[1][0], element[1][0])
            objects = numpy.array(objects, dtype=numpy.dtype(name))
        return values, objects

    def message(self, name):
        values, objects = {}, {}
        for field, desc in self.types.fielddefs[name][1]:
            if field == DUMMY[0]:
                objects[field] = 0
                continue
            values[field], objects[field] = self.field(desc)
        return values, self.types.types[name](**objects)


def json_value(value):
    """Returns a value with the floats that JSON lacks as strings."""
    if isinstance(value, dict):
        return {name: json_value(of) for name, of in value.items()}
    if isinstance(value, list):
        return [json_value(of) for of in value]
    is_number = not isinstance(value, float) or value - value == 0
    return value if is_number else str(value)


def lines():
    types = get_typestore(Stores.ROS2_JAZZY)
    messages, others = definitions(types)
    for name in sorted(messages | others):
        line = {'type': name, 'hash': types.hash_rihs01(name), 'messages': []}
        for is_small in (False, True) if name in messages else ():
            value, message = Values(types, is_small).message(name)
            line['messages'].append({
                'value': json_value(value),
                'little': bytes(types.serialize_cdr(message, name, little_endian=True)).hex(),
                'big': bytes(types.serialize_cdr(message, name, little_endian=False)).hex(),
            })
        yield json.dumps(line, ensure_ascii=False)


def main():
    golden = '\n'.join(lines()) + '\n'
    if sys.argv[1:] == ['--check']:
        if golden != GOLDEN.read_text():
            sys.exit(f'{GOLDEN.name} differs from what rosbags says: run {Path(__file__).name}')
        print(f'{GOLDEN.name} is what rosbags says: {len(golden.splitlines())} types')
        return
    GOLDEN.write_text(golden)


if __name__ == '__main__':
    main()
